"""Start states of the user's own: a file of arrays by MjData field, one row per state.

`numpy.savez(file, **mjbench.record(model, data, nstep, ["qpos", "qvel", "ctrl"]))` writes one. It
needs `qpos`; other fields of mjSTATE_INTEGRATION are used where it has them, and what else it holds
is ignored. `ctrl` is replayed: a row holds the controls of the step that led to its state, as
`record` writes it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from mjbench.errors import InputError, one_line, shown
from mjbench.simulation import compat, workload
from mjbench.simulation.workload import Workload

# Times of neighbouring rows that differ from a step by more than this share of it are not those of
# consecutive steps.
_TIME_SHARE = 0.5


@dataclass(frozen=True, eq=False)
class RecordedStates:
    """The states of a file.

    Attributes:
      fields: by MjData field, each (nrow, size).
      name: of the file, for messages.
    """

    fields: Mapping[str, np.ndarray]
    name: str

    @property
    def nrow(self) -> int:
        """Number of states."""
        return len(self.fields["qpos"])


def read(file: Path, model: mujoco.MjModel) -> RecordedStates:
    """Return the states of a file.

    Raises:
      InputError: it cannot be read, or does not fit the model.
    """
    name = shown(file.name)
    columns = compat.state_columns(model, compat.state_spec("INTEGRATION"))
    recorded, others = _read_arrays(file, name, list(columns))
    if "qpos" not in recorded:
        has = shown(", ".join([*recorded, *others][:8])) if recorded or others else "nothing"
        raise InputError(f"{name} has no qpos, which start states need; it has {has}")
    fields = {
        field: _rows(name, field, values, columns[field]) for field, values in recorded.items()
    }
    nrow = len(fields["qpos"])
    for field, rows in fields.items():
        if len(rows) != nrow:
            raise InputError(f"{name}: {field} has {len(rows)} rows, qpos has {nrow}")
    return RecordedStates(fields, name)


def _read_arrays(
    file: Path, name: str, fields: Sequence[str]
) -> tuple[dict[str, np.ndarray], list[str]]:
    """Return the arrays of a file that are named like fields, and the names of the others.

    Raises:
      InputError: it cannot be read.
    """
    try:
        with file.open("rb") as stream:
            arrays = np.load(stream, allow_pickle=False)
            if isinstance(arrays, np.ndarray):
                raise InputError(f"{name} holds one array: save named ones by numpy.savez")
            recorded = {key: arrays[key] for key in arrays.files if key in fields}
            return recorded, [key for key in arrays.files if key not in fields]
    except InputError:
        raise
    except Exception as error:  # a damaged file: NumPy and zipfile raise many kinds
        raise InputError(
            f"cannot read states from {name}: {one_line(error)}; numpy.savez writes such files"
        ) from error


def _rows(name: str, field: str, values: np.ndarray, place: slice) -> np.ndarray:
    """Return (nrow, size) numbers of a field.

    Raises:
      InputError: it has another size, no row, or what is not a finite number.
    """
    size = place.stop - place.start
    if values.ndim == 0 or len(values) == 0:
        raise InputError(f"{name}: {field} has no rows")
    if values.dtype.kind not in "fiub":
        raise InputError(f"{name}: {field} does not hold numbers")
    width = values.size // len(values)
    if width != size:
        raise InputError(f"{name}: the model's {field} has {size} numbers, the file's {width}")
    rows = values.reshape(len(values), size).astype(float)
    if not np.isfinite(rows).all():
        raise InputError(f"{name}: {field} holds numbers that are not finite")
    return rows


def draw(
    model: mujoco.MjModel,
    recorded: RecordedStates,
    nbatch: int,
    nstep: int,
    hold: int,
    seed: int,
    spread: float,
) -> Workload:
    """Return a workload whose starts are drawn from the rows of a file.

    Rows are drawn at random, each once where there are enough. Where the file has no warm-starts,
    each row is stepped once, so that its warm-start is real. Controls are those that follow the row
    in the file; random ones where it has none.

    Args:
      model: to step.
      recorded: the file's states.
      nbatch: number of simulations.
      nstep: steps of each.
      hold: steps per control.
      seed: of rows and random controls.
      spread: scales the noise of random controls.

    Raises:
      InputError: sizes are below 1, nstep is not a multiple of hold, or too few controls follow.
    """
    workload.check_sizes(nbatch, nstep, hold)
    rng = np.random.default_rng([seed, 0])
    has_warm_start = "qacc_warmstart" in recorded.fields
    first = 1 if has_warm_start else 2  # the row of the first control that is replayed
    replays = "ctrl" in recorded.fields
    candidates = np.arange(recorded.nrow)
    if replays:
        candidates = _followed(model, recorded, first + nstep - hold)
        if len(candidates) == 0:
            raise InputError(
                f"{recorded.name}: no {first + nstep - hold + 1} consecutive rows, which replaying"
                f" {nstep} steps takes; give a smaller --nstep, or leave ctrl out of the file"
            )
    chosen = rng.choice(candidates, nbatch, replace=len(candidates) < nbatch)
    starts = workload.states(model, {k: rows[chosen] for k, rows in recorded.fields.items()})
    if not has_warm_start:
        following = recorded.fields["ctrl"][chosen + 1] if replays else None
        _step_once(model, starts, following)
    if replays:
        steps = first + np.arange(0, nstep, hold)
        control = recorded.fields["ctrl"][chosen[:, None] + steps]
    else:
        noise = np.random.default_rng([seed, 1])
        control = workload.random_controls(model, nbatch, nstep // hold, hold, noise, spread)
    return Workload(model, starts, np.ascontiguousarray(control), hold, seed)


def _followed(model: mujoco.MjModel, recorded: RecordedStates, count: int) -> np.ndarray:
    """Return the rows after which `count` rows of consecutive steps follow."""
    rows = np.arange(max(0, recorded.nrow - count))
    if "time" not in recorded.fields:
        return rows
    time, timestep = recorded.fields["time"][:, 0], float(model.opt.timestep)
    is_gap = np.abs(np.diff(time) - timestep) > _TIME_SHARE * timestep
    gaps = np.concatenate([[0], np.cumsum(is_gap)])
    return np.asarray(rows[gaps[rows + count] == gaps[rows]])


def _step_once(model: mujoco.MjModel, states: np.ndarray, control: np.ndarray | None) -> None:
    """Step each of (nbatch, nstate) states once, in place, with (nbatch, nu) controls if given."""
    data, spec = mujoco.MjData(model), compat.state_spec("INTEGRATION")
    for i, row in enumerate(states):
        mujoco.mj_resetData(model, data)
        compat.set_state(model, data, row, spec)
        if control is not None:
            data.ctrl[:] = control[i]
        mujoco.mj_step(model, data)
        compat.get_state(model, data, row, spec)
