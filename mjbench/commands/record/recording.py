"""Record fields of a simulation: `record(model, data, nstep, ["qpos", "site:pole_tip.xpos"])`.

The most common silent bug of a logging loop is to store `data.qpos`, which is a view: after the
loop every row shows the last state. Here every row is a copy, written into an array that was
allocated before the loop.
"""

import functools
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from mjbench.errors import InputError, one_line, suggestion, wrong_argument
from mjbench.simulation import compat

# Kinds of named elements, and the attribute that a field without one means; None: it needs one.
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
# MjModel's number of elements where it is not `n` and the kind.
_COUNTS = {"actuator": "nu", "camera": "ncam", "joint": "njnt"}
# Fields with as many rows as the step has contacts, or scalar constraints.
_CONTACT, _CONSTRAINT = "contact", "efc_"
# Other fields in the arena (MJDATA_ARENA_POINTERS of mjxmacro.h): not recorded.
_ARENA = re.compile(r"(iefc_|island_|dof_island|map_|i(M|LD|Dinv|acc)|bvh_active|efm_|tree_island)")

Policy = Callable[[mujoco.MjModel, mujoco.MjData], ArrayLike | None]


@dataclass(frozen=True, eq=False)
class Ragged:
    """A field that has another number of rows in each step, such as `contact.dist`.

    It is a sequence of one array a step: `len()` is the number of steps, `[step]` and iteration
    give the rows of a step, (count, …).

    Attributes:
      values: (sum of counts, …) the rows of all steps, one after the other.
      counts: (nstep,) number of rows of each step.
    """

    values: np.ndarray
    counts: np.ndarray

    def __len__(self) -> int:
        return len(self.counts)

    def __getitem__(self, step: int) -> np.ndarray:
        """Return the rows of one step, (count, …); -1 is the last step."""
        step = range(len(self.counts))[step]  # IndexError beyond the last
        begin = int(self.counts[:step].sum())
        return self.values[begin : begin + int(self.counts[step])]

    def __iter__(self) -> Iterator[np.ndarray]:
        return iter(np.split(self.values, np.cumsum(self.counts)[:-1]))


def record(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    nstep: int,
    fields: Sequence[str],
    controls: ArrayLike | None = None,
    policy: Policy | None = None,
    same_moment: bool = False,
) -> dict[str, np.ndarray | Ragged]:
    """Step nstep times; return the fields after every step.

    By default, a row holds two moments: after `mj_step`, qpos, qvel, act and time are those of the
    new state, while what follows from a state (xpos, contacts, sensordata, …) is still that of the
    state before. With `same_moment`, all of a row is that of the new state.

    A field is one of
    - an array or number of MjData: `qpos`, `time`, `xpos`, …;
    - an attribute of a named element, `KIND:NAME.ATTRIBUTE`: `site:pole_tip.xpos`,
      `joint:hinge.qvel`. Joints, sensors and sites may leave the attribute out, which then is
      qpos, data and xpos: `sensor:pole_angle`;
    - a field whose size changes from step to step: `contact.ATTRIBUTE` (`contact.dist`), `efc_…`.

    Args:
      model: that is stepped.
      data: stepped from the state it is in.
      nstep: steps.
      fields: names.
      controls: (nstep, nu) or (nu,), written to `data.ctrl` before each step.
      policy: called with (model, data) before each step; what it returns is written to
        `data.ctrl`, unless it returns None.
      same_moment: whether what follows from the new state is computed after each step, in another
        MjData, so that the steps stay the same. It costs up to the time of a step.

    Returns:
      By field, an array (nstep, *shape), or a `Ragged` for a field whose size changes; with such
      a one comes `ncon` or `nefc`, (nstep,).

    Raises:
      InputError: an unknown field or name (the message suggests near ones), the same field twice,
        both controls and a policy, controls of another shape, or nstep is not a whole number.
    """
    if not isinstance(nstep, int | np.integer) or nstep < 0:
        raise wrong_argument("nstep", nstep, "a whole number, at least 0")
    if not isinstance(model, mujoco.MjModel):
        raise wrong_argument("model", model, "an MjModel")
    if not isinstance(data, mujoco.MjData):
        raise wrong_argument("data", data, "an MjData")
    if not (policy is None or callable(policy)):
        raise wrong_argument("policy", policy, "a function")
    if not isinstance(fields, list | tuple):
        raise wrong_argument("fields", fields, "a list of names")
    if controls is not None and policy is not None:
        raise InputError("give controls or a policy, not both")
    step_controls, names = _step_controls(model, int(nstep), controls), _with_counts(fields)
    of_new_state = mujoco.MjData(model) if same_moment else None
    log = _Log(model, data if of_new_state is None else of_new_state, int(nstep), names)
    _run(model, data, int(nstep), step_controls, policy, log, of_new_state)
    return log.recorded()


class _Log:
    """The rows of all fields, and how the next one is read after a step.

    Attributes:
      views: rows (nstep, …), and the view of MjData that each row is copied from.
      numbers: rows (nstep,), and the function that returns the number as it is now.
      ragged: the rows of each step so far, after an empty array of their shape, and the function
        that copies the next.
    """

    def __init__(
        self, model: mujoco.MjModel, data: mujoco.MjData, nstep: int, fields: Sequence[str]
    ):
        self.views: list[tuple[np.ndarray, np.ndarray]] = []
        self.numbers: list[tuple[np.ndarray, Callable[[], float]]] = []
        self.ragged: list[tuple[list[np.ndarray], Callable[[], np.ndarray]]] = []
        self._rows: dict[str, np.ndarray | list[np.ndarray]] = {}
        for name in fields:
            if _changes_size(name):
                read = _reader(data, name)
                self._rows[name] = steps = [read()[:0]]
                self.ragged.append((steps, read))
                continue
            value = _value(model, data, name)
            if isinstance(value, np.ndarray):
                self._rows[name] = rows = np.empty((nstep, *value.shape), value.dtype)
                self.views.append((rows, value))
            else:
                self._rows[name] = rows = np.empty(nstep, type(value))
                self.numbers.append((rows, functools.partial(getattr, data, name)))

    def recorded(self) -> dict[str, np.ndarray | Ragged]:
        fields: dict[str, np.ndarray | Ragged] = {}
        for name, rows in self._rows.items():
            if isinstance(rows, list):  # the first array has none
                counts = np.array([len(of_step) for of_step in rows[1:]], dtype=int)
                fields[name] = Ragged(np.concatenate(rows), counts)
            else:
                fields[name] = rows
        return fields


def _run(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    nstep: int,
    controls: np.ndarray | None,
    policy: Policy | None,
    log: _Log,
    of_new_state: mujoco.MjData | None,
) -> None:
    """Step and record; everything that a step uses is local, as in a careful loop by hand."""
    mj_step, ctrl = mujoco.mj_step, data.ctrl
    state = np.empty(compat.state_size(model))
    views, numbers, ragged = log.views, log.numbers, log.ragged
    for i in range(nstep):
        if controls is not None:
            ctrl[:] = controls[i]
        elif policy is not None:
            action = policy(model, data)
            if action is not None:  # it may have written data.ctrl itself
                ctrl[:] = action
        mj_step(model, data)
        if of_new_state is not None:
            compat.get_state(model, data, state)
            compat.set_state(model, of_new_state, state)
            mujoco.mj_forward(model, of_new_state)
        for rows, view in views:
            rows[i] = view
        for rows, number in numbers:
            rows[i] = number()
        for steps, read in ragged:
            steps.append(read())


def _step_controls(
    model: mujoco.MjModel, nstep: int, controls: ArrayLike | None
) -> np.ndarray | None:
    """Return (nstep, nu) controls, or None without any."""
    if controls is None:
        return None
    try:
        array = np.asarray(controls, dtype=float)
    except (TypeError, ValueError) as error:
        raise wrong_argument("controls", controls, "numbers") from error
    if array.shape not in ((nstep, model.nu), (model.nu,)):
        raise InputError(
            f"controls have the shape {array.shape}; give (nstep, nu) = ({nstep}, {model.nu})"
            f" or ({model.nu},)"
        )
    return np.broadcast_to(array, (nstep, model.nu))


def _with_counts(fields: Sequence[str]) -> list[str]:
    """Return the fields, and `ncon` or `nefc` where one of them has as many rows."""
    for i, name in enumerate(fields):
        if not isinstance(name, str):
            raise InputError(f"a field is a name, such as 'qpos', not {one_line(repr(name))}")
        if name in fields[:i]:
            raise InputError(f"field {name!r} is given twice")
    counts = {
        "ncon" if name.startswith(_CONTACT) else "nefc" for name in fields if _changes_size(name)
    }
    return list(dict.fromkeys([*fields, *sorted(counts)]))


def _changes_size(name: str) -> bool:
    return name.startswith((f"{_CONTACT}.", _CONSTRAINT))


def _reader(data: mujoco.MjData, name: str) -> Callable[[], np.ndarray]:
    """Return a function that returns a copy of a field that changes size, as it is now."""
    if name.startswith(_CONSTRAINT):
        if not hasattr(data, name):
            known = [n for n in _public(data) if n.startswith(_CONSTRAINT)]
            raise InputError(f"MjData has no field {name!r}{_choices(name, known)}")
        if re.match(r"efc_(J|AR)", name):
            raise InputError(f"{name!r} is a matrix of the constraints, whose size is not nefc")
        return lambda: np.array(getattr(data, name)[: data.nefc])
    attribute = name.partition(".")[2]
    known = _public(data.contact)
    if attribute not in known:
        raise InputError(f"a contact has no {attribute!r}{_choices(attribute, known)}")
    return lambda: np.array(getattr(data.contact, attribute))


def _value(model: mujoco.MjModel, data: mujoco.MjData, name: str) -> np.ndarray | float:
    """Return a field of fixed size: a view of its array, or its number."""
    kind, colon, element = name.partition(":")
    if not colon:
        value = _field(data, name)
    elif kind in _KINDS:
        value = _of_element(model, data, kind, element)
    else:
        raise InputError(f"{name!r}: no kind {kind!r}{_choices(kind, _KINDS)}")
    if isinstance(value, np.ndarray | int | float):
        return value
    raise InputError(f"{name!r} is neither an array nor a number, but {type(value).__name__}")


def _field(data: mujoco.MjData, name: str) -> object:
    if name == _CONTACT:
        raise InputError("name a field of the contacts, such as contact.dist or contact.pos")
    if name.startswith("_") or not hasattr(data, name):
        raise InputError(f"MjData has no field {name!r}{_choices(name, _public(data))}")
    if _ARENA.match(name):
        raise InputError(f"{name!r} is allocated anew in every step, in another size")
    return getattr(data, name)


def _of_element(model: mujoco.MjModel, data: mujoco.MjData, kind: str, text: str) -> object:
    """Return an attribute of a named element, from `NAME.ATTRIBUTE`; NAME may hold dots."""
    count = getattr(model, _COUNTS.get(kind, f"n{kind}"))
    names = [name for i in range(count) if (name := getattr(model, kind)(i).name)]
    name, dot, attribute = text.rpartition(".")
    if text in names or not dot:
        name, attribute = text, _KINDS[kind] or ""
    field = f"{kind}:{text}"
    if name not in names:
        raise InputError(f"{field!r}: no {kind} {name!r}{_choices(name, names)}")
    accessor = getattr(data, kind)(name)
    known = [n for n in _public(accessor) if n not in ("id", "name")]
    if attribute not in known:
        problem = f"no attribute {attribute!r}" if attribute else "no attribute named"
        near = suggestion(attribute, known)
        raise InputError(f"{field!r}: {problem}{near}; there are {', '.join(known)}")
    return getattr(accessor, attribute)


def _public(value: object) -> list[str]:
    return [name for name in dir(value) if not name.startswith("_")]


def _choices(word: str, known: Iterable[str]) -> str:
    """Return the known words near `word`; the first of them where none is near."""
    choices = sorted(known)
    return suggestion(word, choices) or f"; there are {', '.join(choices[:12])}"
