"""Fields of MjOption that a user may set by name, and the values that each can have.

`check` knows what holds in every release, `set_option` also which values this release has.
"""

from collections.abc import Mapping
from typing import Any

import mujoco

from mjbench.errors import InputError, one_line
from mjbench.simulation import compat
from mjbench.simulation.models import MAX_TIMESTEP_S, MIN_TIMESTEP_S

# The engine's mjMAXVAL: it treats larger numbers as a sign of instability.
_MAXVAL = 1e10
# Fields that hold an enum: its name, and what the names of its values begin with.
ENUMS: Mapping[str, tuple[str, str]] = {
    "integrator": ("mjtIntegrator", "mjINT_"),
    "solver": ("mjtSolver", "mjSOL_"),
    "cone": ("mjtCone", "mjCONE_"),
    "jacobian": ("mjtJacobian", "mjJAC_"),
}
# Fields that hold a sum of an enum's values, in the same form.
_FLAGS: Mapping[str, tuple[str, str]] = {
    "disableflags": ("mjtDisableBit", "mjDSBL_"),
    "enableflags": ("mjtEnableBit", "mjENBL_"),
}
_COUNTS = ("iterations", "ls_iterations", "noslip_iterations", "ccd_iterations")
# The most iterations, and the largest sum of flags: MuJoCo holds both in 32 bits.
_MAX_INT = 2**31 - 1
# Lowest and highest value of the other fields.
_NUMBERS: Mapping[str, tuple[float, float]] = {
    "timestep": (MIN_TIMESTEP_S, MAX_TIMESTEP_S),
    "tolerance": (0.0, _MAXVAL),
    "ls_tolerance": (0.0, _MAXVAL),
    "noslip_tolerance": (0.0, _MAXVAL),
    "ccd_tolerance": (0.0, _MAXVAL),
    "impratio": (1e-15, _MAXVAL),
    "density": (0.0, _MAXVAL),
    "viscosity": (0.0, _MAXVAL),
}
FIELDS = ("timestep", *ENUMS, *_COUNTS, *(n for n in _NUMBERS if n != "timestep"), *_FLAGS)


def check(field: str, text: str) -> None:
    """Refuse what `field` cannot be in any release; names of an enum's values are not looked up."""
    if field not in FIELDS:
        raise InputError(f"no option {field!r}; the fields of MjOption are {', '.join(FIELDS)}")
    if field not in ENUMS or _is_number(text):
        _number(field, text)


def set_option(model: mujoco.MjModel, field: str, text: str) -> None:
    _set_field(model.opt, field, text)


def set_attribute(options: Any, name: str, text: str) -> None:
    """Set a field of an MjOption to the value of an attribute of MJCF's `<option>`.

    An enum's value is a keyword there, such as `CG`, and no number; flags are no attributes.
    """
    if name in _FLAGS:
        raise InputError(f"option {name}: in MJCF, flags are attributes of <flag>")
    if name in ENUMS and _is_number(text):
        raise InputError(f"option {name}: in MJCF its value is a keyword, not {text}")
    _set_field(options, name, text)


def set_flag(options: Any, name: str, text: str) -> None:
    """Set the bit of an MjOption that stands for an attribute of MJCF's `<flag>`.

    Some releases have it in `disableflags`, others in `enableflags` (`multiccd`), or in neither.

    Args:
      options: `opt` of an MjModel, or `option` of an MjSpec.
    """
    if text not in ("enable", "disable"):
        raise InputError(f"flag {name}: {one_line(repr(text), 40)} is not enable or disable")
    for field, setting in (("disableflags", "disable"), ("enableflags", "enable")):
        bit = _values(_FLAGS[field]).get(name.upper())
        if bit is not None:
            others = int(getattr(options, field)) & ~bit
            setattr(options, field, others | bit if text == setting else others)
            return
    raise InputError(f"flag {name}: MuJoCo {mujoco.mj_versionString()} has no such flag")


def _set_field(options: Any, field: str, text: str) -> None:
    check(field, text)
    if not hasattr(options, field):
        raise InputError(f"option {field}: MuJoCo {mujoco.mj_versionString()} has no such field")
    if field in ENUMS:
        value: float = _enum_value(field, text)
    elif field in _FLAGS:
        value = _flags(field, text)
    else:
        value = _number(field, text)
    setattr(options, field, value)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _number(field: str, text: str) -> float:
    """Return the number that `text` stands for; a whole one unless the field is in _NUMBERS."""
    is_whole = field not in _NUMBERS
    low, high = _NUMBERS.get(field, (0, _MAX_INT))
    number = float(text) if _is_number(text) else float("nan")
    if low <= number <= high and (number.is_integer() or not is_whole):
        return int(number) if is_whole else number
    limits = f"from 0 to {_MAX_INT}" if is_whole else f"from {low:g} to {high:g}"
    raise InputError(
        f"option {field}: {one_line(repr(text), 40)} is not a {'whole ' * is_whole}number {limits}"
    )


def _values(enum: tuple[str, str]) -> dict[str, int]:
    values = compat.members(getattr(mujoco, enum[0]), enum[1])
    return dict(sorted(values.items(), key=lambda item: item[1]))


def _enum_value(field: str, text: str) -> int:
    values = _values(ENUMS[field])
    value = int(_number(field, text)) if _is_number(text) else values.get(text.upper(), -1)
    if value not in values.values():
        allowed = ", ".join(f"{name} ({number})" for name, number in values.items())
        raise InputError(f"option {field}: {one_line(repr(text), 40)} is not one of {allowed}")
    return value


def _flags(field: str, text: str) -> int:
    flags, value = _values(_FLAGS[field]), int(_number(field, text))
    unknown = value
    for flag in flags.values():
        unknown &= ~flag
    if unknown:
        allowed = ", ".join(f"{flag} ({name})" for name, flag in flags.items())
        raise InputError(
            f"option {field}: {value} is not a sum of {allowed}; no flag has the value {unknown}"
        )
    return value
