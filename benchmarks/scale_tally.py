"""What the simulation of a cluster starts from, and what comes of it."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import TypeVar

from mjbench.errors import InputError, one_line

_Tally = TypeVar("_Tally")


class CellKind(StrEnum):
    """What a cell of the matrix is; the values are for people."""

    VERDICT = "verdict by time"
    COUNT = "count of instructions"
    COMPARISON = "comparison of paths"


@dataclass(frozen=True)
class CellCost:
    """What a cell takes on a model, measured on one machine.

    Attributes:
      kind: of the cell.
      model: its name.
      step_us: microseconds of a step in the plain loop.
      start_s: seconds that its command takes beside its cells, however many they are.
      cell_s: seconds of a cell.
      cell_bytes: of the run file.
    """

    kind: CellKind
    model: str
    step_us: float
    start_s: float
    cell_s: float
    cell_bytes: int


@dataclass(frozen=True)
class CellTally:
    """What cells take, by `benchmarks.cell_cost`.

    Attributes:
      date: of the measurement.
      processor: of the machine.
      usable_cores: of the machine.
      old: release of the verdicts' baseline; counts are of both releases.
      new: release of their candidate.
      cells: one of each kind for each model.
    """

    date: str
    processor: str
    usable_cores: int
    old: str
    new: str
    cells: Sequence[CellCost]


@dataclass(frozen=True)
class SchedulingCost:
    """What handing out commands takes, measured on local Ray nodes.

    Attributes:
      handover_s: seconds from when the driver hands out a command until it starts on its node.
      calibration_s: further seconds where the node must be quiet, for its calibration.
      command_s: seconds of the driver for each command.
      event_s: seconds of the driver for each thing that a node says.
      look_s: seconds of the scheduler for each missing cell and free node, when it hands out cells.
    """

    handover_s: float
    calibration_s: float
    command_s: float
    event_s: float
    look_s: float


@dataclass(frozen=True)
class Assumptions:
    """What nobody measured: how nodes differ, refuse and die.

    Attributes:
      slowness_deviation: standard deviation of the logarithm of the time that nodes take.
      refusals: share of commands that need a quiet machine which a node refuses.
      hours_between_deaths: of one node, in the mean; exponentially distributed.
      detection_s: until the driver knows of a death.
      outage_s: until a node that died is there again.
    """

    slowness_deviation: float = 0.1
    refusals: float = 0.02
    hours_between_deaths: float = 100.0
    detection_s: float = 30.0
    outage_s: float = 900.0


def load_cells(file: Path) -> CellTally:
    """Return the tally of what cells take.

    Raises:
      InputError: the file is not one.
    """
    return _load(file, CellTally, "what cells take")


def _load(file: Path, kind: type[_Tally], what: str) -> _Tally:
    import msgspec

    try:
        return msgspec.json.decode(file.read_bytes(), type=kind)
    except (OSError, msgspec.MsgspecError, UnicodeDecodeError) as error:
        raise InputError(f"{file} is not a tally of {what}: {one_line(error)}") from error
