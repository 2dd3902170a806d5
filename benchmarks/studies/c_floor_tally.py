"""What `benchmarks.c_floor` stores in results/c_floor.json."""

import statistics
from collections.abc import Sequence
from dataclasses import dataclass

from mjbench.instrument.machine import Machine


@dataclass(frozen=True)
class LaunchTimes:
    """What a launch measured: medians over its rounds.

    Attributes:
      c_ns: nanoseconds of a step of the C program.
      c_timer_ns: the same with a timer in its steps.
      python_ns: of the path, as MuJoCo's Python package is imported.
      python_off_ns: the same without the package's timer.
      ratio: the path's time over that of the C program without a timer, in the same round.
      off_ratio: the same without the package's timer.
    """

    c_ns: float
    c_timer_ns: float
    python_ns: float
    python_off_ns: float
    ratio: float
    off_ratio: float


@dataclass(frozen=True)
class Spread:
    """A ratio: the median over launches, and their range."""

    median: float
    low: float
    high: float

    @classmethod
    def of(cls, values: Sequence[float]) -> "Spread":
        """Return that of several launches."""
        return cls(statistics.median(values), min(values), max(values))


@dataclass(frozen=True)
class FloorRow:
    """A path on a model beside the C program.

    Attributes:
      model: its name.
      path: as it is called in Python.
      c_ns: nanoseconds of a step, the median over launches, as the others.
      c_timer_ns: see `LaunchTimes`.
      python_ns: likewise.
      python_off_ns: likewise.
      ratio: likewise.
      off_ratio: likewise.
    """

    model: str
    path: str
    c_ns: float
    c_timer_ns: float
    python_ns: float
    python_off_ns: float
    ratio: Spread
    off_ratio: Spread

    @classmethod
    def of(cls, model: str, path: str, launches: Sequence[LaunchTimes]) -> "FloorRow":
        """Return the row of several launches."""
        return cls(
            model,
            path,
            statistics.median(each.c_ns for each in launches),
            statistics.median(each.c_timer_ns for each in launches),
            statistics.median(each.python_ns for each in launches),
            statistics.median(each.python_off_ns for each in launches),
            Spread.of([each.ratio for each in launches]),
            Spread.of([each.off_ratio for each in launches]),
        )


@dataclass(frozen=True)
class FloorTally:
    """All rows, and where they were measured.

    Attributes:
      machine: that measured.
      launches: of each row.
      rows: by model and path.
    """

    machine: Machine
    launches: int
    rows: Sequence[FloorRow]
