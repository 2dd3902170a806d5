"""What `benchmarks.studies.c_floor` stores in results/c_floor.json."""

import statistics
from collections.abc import Sequence
from dataclasses import dataclass

from mjbench.host.machine import Machine


@dataclass(frozen=True)
class LaunchTimes:
    """What a launch measured: medians over its rounds.

    Attributes:
      c_timer_ns: the same with a timer in its steps.
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
      c_ns: nanoseconds of a step, the median over launches.
      c_timer_ns: see `LaunchTimes` for this and the others.
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
    """All rows, and where they were measured."""

    machine: Machine
    launches: int
    rows: Sequence[FloorRow]
