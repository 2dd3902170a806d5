"""The one place that knows how MuJoCo releases differ, from 2.3.7 on.

It looks everything up by name, never by release number (enum values change between releases).
Nothing here but `forget_computed` belongs inside a timed region; its time is subtracted.
"""

import copy
import functools
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np

# Components of mjSTATE_INTEGRATION that are called otherwise than the MjData field with them.
_FIELD_OF_STATE = {"WARMSTART": "qacc_warmstart", "PLUGIN": "plugin_state"}
# Warnings after which a simulation is no longer the one asked for: numbers were huge or not finite,
# so the engine started it anew, or ignored its controls.
_DIVERGENCE = ("BADQPOS", "BADQVEL", "BADQACC", "BADCTRL")


def members(enum: Any, prefix: str) -> dict[str, int]:
    """Return the values of an enum of MuJoCo by their names, without the prefix of all."""
    names = [name for name in dir(enum) if name.startswith(prefix)]
    return {name.removeprefix(prefix): int(getattr(enum, name)) for name in names}


@functools.cache
def state_spec(name: str) -> int:
    return int(getattr(mujoco.mjtState, f"mjSTATE_{name}"))


# All that a step depends on; and what `mujoco.rollout` starts from and returns.
INTEGRATION, FULLPHYSICS = state_spec("INTEGRATION"), state_spec("FULLPHYSICS")


def state_size(model: mujoco.MjModel, spec: int = INTEGRATION) -> int:
    return int(mujoco.mj_stateSize(model, spec))


def get_state(
    model: mujoco.MjModel, data: mujoco.MjData, out: np.ndarray, spec: int = INTEGRATION
) -> None:
    """Copy the state components in `spec` to `out`, a contiguous float64 row."""
    mujoco.mj_getState(model, data, out, spec)  # by position: the keyword was renamed in 3.3.6


def set_state(
    model: mujoco.MjModel, data: mujoco.MjData, row: np.ndarray, spec: int = INTEGRATION
) -> None:
    """Write the state components in `spec` from `row`, a contiguous float64 row."""
    mujoco.mj_setState(model, data, row, spec)


def restart(model: mujoco.MjModel, data: mujoco.MjData, state: np.ndarray) -> None:
    """Reset `data`, also in what is not part of a state, and write a row of mjSTATE_INTEGRATION."""
    mujoco.mj_resetData(model, data)
    set_state(model, data, state)


def state_columns(model: mujoco.MjModel, spec: int = INTEGRATION) -> dict[str, slice]:
    """Return the columns of each MjData field that is not empty in a state row of `spec`.

    A row holds the components in the order of their bits (mj_getState).
    """
    fields = {
        bit: _FIELD_OF_STATE.get(name, name.lower())
        for name, bit in members(mujoco.mjtState, "mjSTATE_").items()
        if bit & spec and bit.bit_count() == 1
    }
    columns, start = {}, 0
    for bit, field in sorted(fields.items()):
        size = state_size(model, bit)
        if size:
            columns[field] = slice(start, start + size)
        start += size
    return columns


def physics_entries(model: mujoco.MjModel) -> np.ndarray:
    """Return (nphysics,) which entries of mjSTATE_INTEGRATION form mjSTATE_FULLPHYSICS."""
    columns = state_columns(model)
    return np.concatenate([np.r_[columns[name]] for name in state_columns(model, FULLPHYSICS)])


def rollout_threads() -> bool:
    """Return whether `mujoco.rollout` of this release runs on threads (3.2.7 on)."""
    from mujoco import rollout

    return hasattr(rollout, "Rollout")


# Functions called `…_unavailable` say why something cannot be done here; None where it can.


def _newer(version: str) -> str:
    return f"MuJoCo {version} or newer (pip install --upgrade mujoco)"


def rollout_unavailable() -> str | None:
    try:
        import inspect

        from mujoco import rollout
    except ImportError as error:
        return f"needs mujoco.rollout ({error}): {_newer('3.1.2')}"
    if "control_spec" not in inspect.signature(rollout.rollout).parameters:
        return f"needs a mujoco.rollout that takes full physics states: {_newer('3.1.2')}"
    return None


def rollout_threads_unavailable() -> str | None:
    return None if rollout_threads() else f"needs a mujoco.rollout with threads: {_newer('3.2.7')}"


def spec_unavailable() -> str | None:
    return None if hasattr(mujoco, "MjSpec") else f"needs MjSpec: {_newer('3.2.0')}"


def threadpool_unavailable() -> str | None:
    if not hasattr(mujoco, "mju_threadpool"):
        return f"needs mju_threadpool: {_newer('3.10.0')}"
    return None


def has_bind() -> bool:
    return hasattr(mujoco.MjData, "bind")


def timer(name: str) -> int | None:
    """Return the index of an engine timer such as `STEP`; None where this release lacks it."""
    value = getattr(mujoco.mjtTimer, f"mjTIMER_{name}", None)
    return None if value is None else int(value)


def batch_unavailable() -> str | None:
    try:
        from mujoco import batch  # noqa: F401
    except ImportError:
        return f"needs mujoco.batch: {_newer('3.17.0')}"
    return None


def solver_iterations(data: mujoco.MjData) -> np.ndarray:
    """Return (nisland,) solver iterations of the last step, one entry per constraint island.

    A release that solves all constraints together, or has islands disabled, has one entry.
    """
    if hasattr(data, "solver_niter"):
        islands = max(1, min(int(data.nisland), len(data.solver_niter)))
        return np.array(data.solver_niter[:islands])
    return np.array([data.solver_iter])


def line_search_iterations(data: mujoco.MjData) -> int:
    """Return the iterations of the longest line search of the last step; 0 without any.

    They are the cost evaluations of mjSolverStat, which `ls_iterations` bounds, by and large: there
    are at least 2, and some releases add up to 2 at the end.
    """
    evaluations = np.array(data.solver.neval)
    slots = len(data.solver_niter) if hasattr(data, "solver_niter") else 1
    by_island = evaluations.reshape(slots, -1)
    used = zip(by_island, solver_iterations(data), strict=False)
    return max((int(row[:count].max(initial=0)) for row, count in used), default=0)


def warning_counts(data: mujoco.MjData) -> np.ndarray:
    return np.array(data.warning.number)


def warning_names() -> list[str]:
    """Return the names of mjtWarning in counter order, such as `BADQPOS`."""
    names = {number: name for name, number in members(mujoco.mjtWarning, "mjWARN_").items()}
    return [names.get(i, str(i)) for i in range(int(mujoco.mjtWarning.mjNWARNING))]


def divergence_warnings() -> np.ndarray:
    """Return (nwarning,) bool: which warnings mean that a simulation diverged."""
    return np.array([name in _DIVERGENCE for name in warning_names()])


def known(function: Callable[..., Any], **keywords: Any) -> dict[str, Any]:
    """Return the keyword arguments that a function accepts in this release."""
    import inspect

    names = inspect.signature(function).parameters
    return {name: value for name, value in keywords.items() if name in names}


def mjx_own(data: Any) -> Any:
    """Return what has the fields of one implementation of MJX: `data._impl`, or older, `data`."""
    return getattr(data, "_impl", data)


def timer_is_installed_at_import() -> bool:
    """Return whether importing MuJoCo installs its timer (3.14 on), and not creating an MjData."""
    major, minor = mujoco.__version__.split(".")[:2]
    return (int(major), int(minor)) >= (3, 14)


def sleep_skips_static() -> bool:
    """Return whether sleep leaves out what no joint moves, as from 4.0.0 on."""
    return bool(mujoco.mj_version() >= 400)


def has_sleep(model: mujoco.MjModel) -> bool:
    """Return whether the model enables sleep, which is not part of mjSTATE_INTEGRATION."""
    bit = getattr(mujoco.mjtEnableBit, "mjENBL_SLEEP", None)
    return bit is not None and bool(model.opt.enableflags & int(bit))


def copied_data(
    model: mujoco.MjModel, target: mujoco.MjData, source: mujoco.MjData
) -> mujoco.MjData:
    """Return a copy of an MjData, all of it: `target`, where this release can copy into one."""
    if hasattr(mujoco, "mj_copyData"):
        mujoco.mj_copyData(target, model, source)
        return target
    return copy.copy(source)


def cast_rays(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    origin: np.ndarray,
    vectors: np.ndarray,
    geoms: np.ndarray,
    distances: np.ndarray,
) -> None:
    """Cast (nray, 3) rays from one point by `mj_multiRay`, into (nray,) geoms and distances."""
    nray = len(vectors)
    mujoco.mj_multiRay(
        *(model, data, origin, vectors.ravel(), None, 1, -1, geoms, distances),
        *((None,) if _takes_normals() else ()),
        *(nray, mujoco.mjMAXVAL),
    )


@functools.cache
def _takes_normals() -> bool:
    """Return whether `mj_multiRay` also takes the normals of surfaces; only its text tells."""
    return "normal" in (mujoco.mj_multiRay.__doc__ or "")


def sensor_shares(model: mujoco.MjModel) -> np.ndarray:
    """Return (nsensor,) in which share of the steps each sensor is computed: 1 without interval."""
    period = np.array(getattr(model, "sensor_interval", np.zeros((model.nsensor, 2))))[:, 0]
    timestep = model.opt.timestep
    return np.asarray(np.minimum(1.0, timestep / np.where(period > 0, period, timestep)))


def trees_asleep(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """Return (ntree,) bool: which kinematic trees sleep; (0,) where sleeping is not enabled."""
    if not has_sleep(model):
        return np.zeros(0, dtype=bool)
    return np.asarray(data.tree_asleep) >= 0


# Of mjData, where the release has them: what was computed for a state already.
_COMPUTED_FLAGS = tuple(name for name in dir(mujoco.MjData) if name.startswith("flg_"))


def forget_computed(data: mujoco.MjData) -> None:
    """Have functions of the engine compute again what they computed for this state."""
    for name in _COMPUTED_FLAGS:
        setattr(data, name, 0)


def include_margin(model: mujoco.MjModel, one: int, other: int) -> float:
    """Return the distance in m below which a contact of two geoms acts.

    Older releases took the larger margin of two geoms, less the larger gap; by 3.9.0, margins add
    up, and a gap leaves them as they are.
    """
    geoms, has_sums = [one, other], _margins_add()
    for i in range(model.npair):
        if {model.pair_geom1[i], model.pair_geom2[i]} == {one, other}:
            return float(model.pair_margin[i] - (0.0 if has_sums else model.pair_gap[i]))
    margins, gaps = model.geom_margin[geoms], model.geom_gap[geoms]
    return float(margins.sum() if has_sums else margins.max() - gaps.max())


@functools.cache
def _margins_add() -> bool:
    """Return whether margins of two geoms that touch add up in this release."""
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><geom type='plane' size='1 1 1' margin='.1'/>"
        "<body><freejoint/><geom size='.1' margin='.1'/></body></worldbody></mujoco>"
    )
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return float(data.contact[0].includemargin) > 0.15


def enum_name(enum: Any, value: int, prefix: str) -> str:
    """Return the name of an enum's value without its prefix, such as `newton` for mjSOL_NEWTON."""
    names = {number: name.lower() for name, number in members(enum, prefix).items()}
    return names.get(int(value), str(int(value)))


def flag_enabled(model: mujoco.MjModel, name: str) -> bool | None:
    """Return whether a flag of MJCF's `<flag>` is enabled; None where this release lacks it.

    Some flags enabled a feature in older releases and disable it in newer ones.
    """
    disables = getattr(mujoco.mjtDisableBit, f"mjDSBL_{name.upper()}", None)
    if disables is not None:
        return not int(model.opt.disableflags) & int(disables)
    enables = getattr(mujoco.mjtEnableBit, f"mjENBL_{name.upper()}", None)
    return None if enables is None else bool(int(model.opt.enableflags) & int(enables))


def disable_flag(model: mujoco.MjModel, name: str) -> None:
    if (disables := getattr(mujoco.mjtDisableBit, f"mjDSBL_{name.upper()}", None)) is not None:
        model.opt.disableflags |= int(disables)
    if (enables := getattr(mujoco.mjtEnableBit, f"mjENBL_{name.upper()}", None)) is not None:
        model.opt.enableflags &= ~int(enables)


def has_geom_distance() -> bool:
    return hasattr(mujoco, "mj_geomDistance")


def flag_names(model: mujoco.MjModel) -> list[str]:
    flags = (
        (mujoco.mjtDisableBit, "mjDSBL_", int(model.opt.disableflags)),
        (mujoco.mjtEnableBit, "mjENBL_", int(model.opt.enableflags)),
    )
    return sorted(
        f"{prefix}{name}"
        for enum, prefix, bits in flags
        for name, bit in members(enum, prefix).items()
        if bit.bit_count() == 1 and bit & bits
    )
