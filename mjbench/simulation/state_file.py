"""Start states of the user's own: a file of arrays by MjData field, one row per state.

`mjbench.capture` writes one, and so does `numpy.savez(file, **mjbench.record(model, data, nstep,
["qpos", "qvel", "ctrl"]))`. It needs `qpos`; other fields of mjSTATE_INTEGRATION are used where it
has them, and what else it holds is ignored. `ctrl` is replayed: a row holds the controls of the
step that led to its state, as `record` writes it. What `capture` writes says which rows are
consecutive steps, and of which model (see `capture_header`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import mujoco
import numpy as np

from mjbench.errors import InputError, shown
from mjbench.simulation import array_files, capture_header, compat, workload
from mjbench.simulation.capture_header import CaptureHeader
from mjbench.simulation.given_controls import GivenControls
from mjbench.simulation.workload import Workload

# Times of neighbouring rows that differ from a step by more than this share of it are not those of
# consecutive steps.
_TIME_SHARE = 0.5
# Fields that are zero unless a program sets them: left out of a file where they are.
_USUALLY_ZERO = ("qfrc_applied", "xfrc_applied", "userdata")


@dataclass(frozen=True, eq=False)
class RecordedStates:
    """The states of a file.

    Attributes:
      fields: by MjData field, each (nrow, size).
      segment: (nrow,) segment of each row; rows of one segment are consecutive steps.
    """

    fields: Mapping[str, np.ndarray]
    name: str
    segment: np.ndarray
    header: CaptureHeader | None = None

    @property
    def nrow(self) -> int:
        return len(self.fields["qpos"])

    @property
    def replays(self) -> bool:
        """Whether controls follow its states."""
        return "ctrl" in self.fields

    @property
    def first(self) -> int:
        """The row, from that of a state, of the first control that is replayed.

        Where the file has no warm-starts, the row's state is stepped once first.
        """
        return 1 if "qacc_warmstart" in self.fields else 2

    def followed(self, nstep: int, hold: int) -> np.ndarray:
        """Return the rows after which the file has controls for so many steps, or needs none."""
        rows = np.arange(self.nrow)
        if not self.replays:
            return rows
        count = self.first + nstep - hold
        rows = rows[: max(0, self.nrow - count)]
        return np.asarray(rows[self.segment[rows] == self.segment[rows + count]])

    def most_nstep(self, nstart: int, hold: int) -> int | None:
        """Return a multiple of `hold`: steps that the file has controls for; None for any number.

        From that many steps on, there would be fewer than `nstart` starts (or than half of all, in
        a short file), or half of its steps would be in segments too short to start from.
        """
        if not self.replays:
            return None
        _, lengths = np.unique(self.segment, return_counts=True)
        lengths = np.sort(lengths - self.first)[::-1]
        lengths = lengths[lengths > 0]
        total = int(lengths.sum())
        if total == 0:
            return hold
        usual = int(lengths[np.searchsorted(np.cumsum(lengths), total / 2)])
        wanted = min(nstart, -(-total // 2))
        low, high = 1, usual + hold - 1
        while low < high:  # the largest number that leaves enough starts
            middle = (low + high + 1) // 2
            if len(self.followed(middle, hold)) >= wanted:
                low = middle
            else:
                high = middle - 1
        return max(hold, low // hold * hold)


def write(
    stream: BinaryIO,
    header: CaptureHeader,
    columns: Mapping[str, slice],
    segments: Sequence[np.ndarray],
) -> None:
    """Write captured states; a segment is (count, nstate) states of consecutive steps."""
    states = np.concatenate(segments)
    fields = {field: states[:, place] for field, place in columns.items()}
    fields = {k: rows for k, rows in fields.items() if k not in _USUALLY_ZERO or rows.any()}
    segment = np.repeat(np.arange(len(segments)), [len(rows) for rows in segments])
    arrays = {capture_header.ARRAY: header.array(), capture_header.SEGMENT_ARRAY: segment, **fields}
    np.savez(stream, **arrays)  # type: ignore[arg-type]  # one is no `allow_pickle`


def read(file: Path, model: mujoco.MjModel) -> RecordedStates:
    name = shown(file.name)
    columns = compat.state_columns(model)
    wanted = [*columns, capture_header.ARRAY, capture_header.SEGMENT_ARRAY]
    content = array_files.read(file, "states", wanted)
    if content.unnamed is not None:
        raise InputError(f"{name} holds one array: save named ones by numpy.savez")
    arrays, header = dict(content.arrays), None
    if capture_header.ARRAY in arrays:
        header = CaptureHeader.of_array(arrays.pop(capture_header.ARRAY), name)
        header.check(model, name)
    segment = arrays.pop(capture_header.SEGMENT_ARRAY, None)
    if "qpos" not in arrays:
        raise InputError(f"{name} has no qpos, which start states need; it has {content.listing}")
    fields = {field: _rows(name, field, values, columns[field]) for field, values in arrays.items()}
    nrow = len(fields["qpos"])
    for field, rows in fields.items():
        if len(rows) != nrow:
            raise InputError(f"{name}: {field} has {len(rows)} rows, qpos has {nrow}")
    if header is None:
        return RecordedStates(fields, name, _segments_by_time(model, fields, nrow))
    return RecordedStates(fields, name, _checked_segment(name, segment, nrow), header)


def _checked_segment(name: str, segment: np.ndarray | None, nrow: int) -> np.ndarray:
    if (
        segment is None
        or segment.shape != (nrow,)
        or segment.dtype.kind not in "iu"
        or (segment[1:] < segment[:-1]).any()
    ):
        raise InputError(
            f"{name}: {capture_header.SEGMENT_ARRAY} does not say which rows are consecutive"
            " steps: capture it again"
        )
    return segment


def _segments_by_time(
    model: mujoco.MjModel, fields: Mapping[str, np.ndarray], nrow: int
) -> np.ndarray:
    """Return the segment of each row, (nrow,): where there is time, a gap begins another one."""
    if "time" not in fields:
        return np.zeros(nrow, dtype=int)
    time, timestep = fields["time"][:, 0], float(model.opt.timestep)
    is_gap = np.abs(np.diff(time) - timestep) > _TIME_SHARE * timestep
    return np.concatenate([[0], np.cumsum(is_gap)])


def _rows(name: str, field: str, values: np.ndarray, place: slice) -> np.ndarray:
    size = place.stop - place.start
    if values.ndim == 0 or len(values) == 0:
        raise InputError(f"{name}: {field} has no rows")
    values = array_files.floats(values, f"{name}: {field}")
    width = values.size // len(values)
    if width != size:
        raise InputError(f"{name}: the model's {field} has {size} numbers, the file's {width}")
    return values.reshape(len(values), size)


def draw(
    model: mujoco.MjModel,
    recorded: RecordedStates,
    nbatch: int,
    nstep: int,
    hold: int,
    seed: int,
    spread: float,
    given: GivenControls | None = None,
) -> Workload:
    """Return a workload whose starts are drawn from the rows of a file.

    Rows are drawn at random, each once where there are enough. Where the file has no warm-starts,
    each row is stepped once, so that its warm-start is real. Controls are those that follow the row
    in the file, unless others are given; random ones where there are none.
    """
    workload.check_sizes(nbatch, nstep, hold)
    rng = np.random.default_rng([seed, 0])
    replays = recorded.replays and given is None
    candidates = recorded.followed(nstep, hold) if replays else np.arange(recorded.nrow)
    if len(candidates) == 0:
        raise InputError(
            f"{recorded.name}: no {recorded.first + nstep - hold + 1} consecutive rows, which"
            f" replaying {nstep} steps takes; give a smaller --nstep, or leave ctrl out of the file"
        )
    chosen = rng.choice(candidates, nbatch, replace=len(candidates) < nbatch)
    starts = workload.states(model, {k: rows[chosen] for k, rows in recorded.fields.items()})
    if recorded.first == 2:
        following = recorded.fields["ctrl"][chosen + 1] if replays else None
        starts = workload.stepped(model, starts, following)
    if given is not None:
        control = given.of_states(chosen, recorded.nrow, nstep // hold)
    elif replays:
        steps = recorded.first + np.arange(0, nstep, hold)
        control = recorded.fields["ctrl"][chosen[:, None] + steps]
    else:
        return workload.starting(model, starts, nstep, hold, seed, spread)
    return Workload(model, starts, np.ascontiguousarray(control), hold, seed)
