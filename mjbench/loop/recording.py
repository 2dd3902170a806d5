"""Record fields of a simulation: `record(model, data, nstep, ["qpos", "site:pole_tip.xpos"])`.

The commonest silent bug of a logging loop is to keep `data.qpos`, which is a view: after the loop
every row shows the last state. Here every row is a copy, written into an array made beforehand.
"""

import difflib
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from mjbench.errors import InputError

# Kinds of named things, and the attribute that is meant where none is named.
_KINDS = {
    "actuator": None,
    "body": None,
    "camera": None,
    "geom": None,
    "joint": "qpos",
    "light": None,
    "sensor": "data",
    "site": "xpos",
    "tendon": None,
}
# Fields whose size is that of the step: contacts, and one row a constraint.
_CONTACT, _CONSTRAINT = "contact", "efc_"
# Fields that lie in the arena besides (MJDATA_ARENA_POINTERS of mjxmacro.h): not recorded.
_ARENA = re.compile(r"(iefc_|island_|dof_island|map_|i(M|LD|Dinv|acc)|bvh_active|efm_|tree_island)")

Policy = Callable[[Any, Any], Any]


@dataclass(frozen=True, eq=False)
class Ragged:
    """A field that has another number of rows in each step.

    Attributes:
      values: (sum of counts, …) the rows of all steps, one after the other.
      counts: (nstep,) rows of each step.
    """

    values: np.ndarray
    counts: np.ndarray

    def __len__(self) -> int:
        """Return the number of steps."""
        return len(self.counts)

    def __getitem__(self, step: int) -> np.ndarray:
        """Return the rows of one step, (count, …)."""
        step = range(len(self.counts))[step]
        begin = int(self.counts[:step].sum())
        return self.values[begin : begin + int(self.counts[step])]

    def __iter__(self) -> Iterator[np.ndarray]:
        """Yield the rows of each step."""
        return iter(np.split(self.values, np.cumsum(self.counts)[:-1]))


def record(
    model: Any,
    data: Any,
    nstep: int,
    fields: Sequence[str],
    controls: Any = None,
    policy: Policy | None = None,
) -> dict[str, Any]:
    """Step nstep times; return the fields after every step.

    A field is an array or number of MjData (`qpos`, `time`, `xpos`, …); a part of something named,
    `KIND:NAME.ATTRIBUTE` (`site:pole_tip.xpos`, `joint:hinge.qpos`, `sensor:pole_angle`, where the
    attribute may be left out for joints (qpos), sensors (data) and sites (xpos)); or a field that
    changes its size: `contact.ATTRIBUTE` (`contact.dist`) and `efc_…`.

    Args:
      model: the MjModel.
      data: the MjData, stepped from where it is.
      nstep: steps.
      fields: names.
      controls: (nstep, nu) or (nu,), written to `data.ctrl` before each step.
      policy: called with (model, data) before each step; what it returns is written to
        `data.ctrl`, unless it returns None.

    Returns:
      By field, an array (nstep, *shape), or a `Ragged` for a field that changes its size; with
      such a one comes `ncon` or `nefc`, (nstep,).

    Raises:
      InputError: an unknown field or name (the message lists near ones), the same field twice,
        both controls and a policy, or controls of another shape.
    """
    if nstep < 0:
        raise InputError(f"nstep must be at least 0, got {nstep}")
    given = _controls(model, nstep, controls)
    if given is not None and policy is not None:
        raise InputError("give controls or a policy, not both")
    twice = sorted({name for name in fields if list(fields).count(name) > 1})
    if twice:
        raise InputError(f"field {twice[0]!r} is asked for twice")
    counts = {_count_of(name) for name in fields if _changes_size(name)}
    fields = list(dict.fromkeys([*fields, *sorted(counts)]))  # a count asked for comes once
    fixed: list[tuple[np.ndarray, np.ndarray]] = []
    numbers: list[tuple[np.ndarray, str]] = []
    ragged: list[tuple[list[np.ndarray], Callable[[], np.ndarray]]] = []
    rows: dict[str, Any] = {}
    for name in fields:
        if _changes_size(name):
            taken: list[np.ndarray] = []
            ragged.append((taken, _reader(data, name)))
            rows[name] = taken
            continue
        view = _view(model, data, name)
        if isinstance(view, np.ndarray):
            rows[name] = np.empty((nstep, *view.shape), view.dtype)
            fixed.append((rows[name], view))
        else:
            rows[name] = np.empty(nstep, type(view))
            numbers.append((rows[name], name))
    _loop(model, data, nstep, given, policy, fixed, numbers, ragged)
    return {name: _assembled(data, name, found) for name, found in rows.items()}


def _loop(
    model: Any,
    data: Any,
    nstep: int,
    controls: np.ndarray | None,
    policy: Policy | None,
    fixed: Sequence[tuple[np.ndarray, np.ndarray]],
    numbers: Sequence[tuple[np.ndarray, str]],
    ragged: Sequence[tuple[list[np.ndarray], Callable[[], np.ndarray]]],
) -> None:
    mj_step, ctrl = mujoco.mj_step, data.ctrl
    for i in range(nstep):
        if controls is not None:
            ctrl[:] = controls[i]
        elif policy is not None:
            values = policy(model, data)
            if values is not None:  # it may have written data.ctrl itself
                ctrl[:] = values
        mj_step(model, data)
        for rows, view in fixed:
            rows[i] = view
        for rows, name in numbers:
            rows[i] = getattr(data, name)
        for taken, read in ragged:
            taken.append(read())


def _controls(model: Any, nstep: int, controls: Any) -> np.ndarray | None:
    if controls is None:
        return None
    array = np.asarray(controls, dtype=float)
    if array.shape not in ((nstep, model.nu), (model.nu,)):
        raise InputError(
            f"controls have the shape {array.shape}; give (nstep, nu) = ({nstep}, {model.nu})"
            f" or ({model.nu},)"
        )
    return np.broadcast_to(array, (nstep, model.nu))


def _changes_size(name: str) -> bool:
    return name.startswith((f"{_CONTACT}.", _CONSTRAINT))


def _count_of(name: str) -> str:
    return "ncon" if name.startswith(_CONTACT) else "nefc"


def _reader(data: Any, name: str) -> Callable[[], np.ndarray]:
    """Return a function that copies a field that changes its size, as it is now."""
    if name.startswith(_CONSTRAINT):
        if not hasattr(data, name):
            known = [n for n in dir(data) if n.startswith(_CONSTRAINT)]
            raise InputError(f"MjData has no field {name!r}{_near(name, known)}")
        if re.match(r"efc_(J|AR)", name):
            raise InputError(f"{name!r} is a matrix of the constraints, whose size is not nefc")
        return lambda: np.array(getattr(data, name)[: data.nefc])
    attribute = name.partition(".")[2]
    if attribute.startswith("_") or not hasattr(data.contact, attribute):
        known = [n for n in dir(data.contact) if not n.startswith("_")]
        raise InputError(f"a contact has no {attribute!r}{_near(attribute, known)}")
    # rows beyond ncon are of earlier steps
    return lambda: np.array(getattr(data.contact, attribute)[: data.ncon])


def _view(model: Any, data: Any, name: str) -> Any:
    """Return a view of a field of fixed size, or a number."""
    kind, colon, rest = name.partition(":")
    if not colon:
        value = _field(data, name)
    else:
        if kind not in _KINDS:
            raise InputError(f"{name!r}: no kind {kind!r}{_near(kind, _KINDS)}")
        value = _named(model, data, name, kind, rest)
    if isinstance(value, np.ndarray) or (np.isscalar(value) and not isinstance(value, str)):
        return value
    raise InputError(f"{name!r} is neither an array nor a number, but {type(value).__name__}")


def _field(data: Any, name: str) -> Any:
    if name == _CONTACT:
        raise InputError("name a field of the contacts, such as contact.dist or contact.pos")
    if name.startswith("_") or not hasattr(data, name):
        known = [n for n in dir(data) if not n.startswith("_")]
        raise InputError(f"MjData has no field {name!r}{_near(name, known)}")
    if _ARENA.match(name):
        raise InputError(f"{name!r} is made anew in every step, and its size with it")
    return getattr(data, name)


def _named(model: Any, data: Any, name: str, kind: str, rest: str) -> Any:
    """Return a view of an attribute of something named; a name may hold dots."""
    names = _names(model, kind)
    own, dot, attribute = rest.rpartition(".")
    if rest in names or not dot:
        own, attribute = rest, _KINDS[kind] or ""
    if own not in names:
        raise InputError(f"{name!r}: no {kind} {own!r}{_near(own, names)}")
    accessor = getattr(data, kind)(own)
    known = [n for n in dir(accessor) if not n.startswith("_") and n not in ("id", "name")]
    if attribute not in known:
        asked = f"no attribute {attribute!r}" if attribute else "no attribute named"
        raise InputError(
            f"{name!r}: {asked}{_near(attribute, known)}; there are {', '.join(known)}"
        )
    return getattr(accessor, attribute)


def _names(model: Any, kind: str) -> list[str]:
    objects = {"actuator": "nu", "camera": "ncam", "joint": "njnt"}
    count = getattr(model, objects.get(kind, f"n{kind}"))
    return [getattr(model, kind)(i).name for i in range(count)]


def _assembled(data: Any, name: str, found: Any) -> Any:
    if isinstance(found, np.ndarray):
        return found
    counts = np.array([len(rows) for rows in found], dtype=int)
    values = np.concatenate(found) if found else np.array(_reader(data, name)())[:0]
    return Ragged(values, counts)


def _near(word: str, known: Any) -> str:
    close = difflib.get_close_matches(word, list(known), n=4, cutoff=0.5)
    return (
        f" (near: {', '.join(close)})" if close else f"; there are {', '.join(sorted(known)[:12])}"
    )
