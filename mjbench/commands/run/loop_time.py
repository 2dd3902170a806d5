"""Where the time of one loop goes."""

import math
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

from mjbench.bounds import NonNegativeInt, PositiveFloat, Share
from mjbench.commands.run.activities import WAITING, Activity, Place
from mjbench.commands.run.call_times import CallTime
from mjbench.commands.run.source_loops import SourceLoop

# Fewer samples tell little.
FEW_SAMPLES = 30
# A loop of which physics takes this much has little else to change.
MOSTLY_PHYSICS = 0.8
# A call in a loop that is made less often than this belongs to the set-up.
LEAST_REPEATS = 3
# Lines with a smaller share of a loop are left out.
LEAST_LINE_SHARE = 0.005

_Key = TypeVar("_Key")


@dataclass(frozen=True)
class LineTime:
    """What one line of the user's code takes of a loop, with all that it calls.

    Attributes:
      place: the line.
      share: of the loop's time.
      activities: share of the loop's time by activity, largest first; they sum to `share`.
      package: installed package that it calls for most of this time; "" for none.
    """

    place: Place
    share: Share
    activities: Mapping[Activity, Share]
    package: str = ""

    def __post_init__(self) -> None:
        if not self.activities:
            raise ValueError("a line has no activity")

    @classmethod
    def of(
        cls,
        place: Place,
        parts: Iterable[tuple[Activity, float]],
        total_s: float,
        package: str = "",
    ) -> "LineTime":
        shares = shares_of(parts, total_s)
        return cls(place, min(1.0, sum(shares.values())), shares, package)

    @property
    def main_activity(self) -> Activity:
        return max(self.activities, key=lambda activity: self.activities[activity])


@dataclass(frozen=True)
class LineStay:
    """How long a thread was on one line, as consecutive samples saw it."""

    place: Place
    seconds: PositiveFloat


@dataclass(frozen=True)
class LoopTime:
    """Where the time of one loop goes.

    Attributes:
      loop: in the program's source; its file is as `activities.shown_path` gives it.
      own_files: the user's own files whose lines run in it, as `activities.shown_path` gives them.
      threads: names of the threads that run it, one for each thread of each process.
      pids: processes that run it.
      in_main: whether the main thread of the program's first process runs it.
      samples: taken in it; where some stand for more time than others, how many equal ones tell as
        much (Kish's effective sample size).
      seconds: wall time in it, summed over threads: samples times their interval.
      activities: share by activity, largest first; they sum to 1.
      lines: of the user's code, with all that they call, by share.
      lines_on_stack: of the user's code, with the lines of the user's functions that they call, by
        share, as samples show them; the shares of lines that call each other overlap.
      inner_functions: of installed packages, without what they call in Python and without physics,
        by share; the place of each is the line that samples saw most often.
      calls: of functions that are timed one by one, from lines of this loop.
      building: the outermost line under which models are built or loaded, and nothing steps; of
        several, that which builds most, with the time of all. None without one.
      unpickling_share: of its time, for which another process takes apart what it is sent.
      longest_stay: the longest on a line that does not sleep; None where each may be chance.
    """

    loop: SourceLoop
    own_files: Sequence[str]
    threads: Sequence[str]
    pids: Sequence[NonNegativeInt]
    in_main: bool
    samples: NonNegativeInt
    seconds: PositiveFloat
    activities: Mapping[Activity, Share]
    lines: Sequence[LineTime]
    inner_functions: Sequence[LineTime]
    calls: Sequence[CallTime] = ()
    building: LineTime | None = None
    longest_stay: LineStay | None = None
    lines_on_stack: Sequence[LineTime] = ()
    unpickling_share: Share = 0.0

    @property
    def seconds_of_thread(self) -> float:
        """Seconds of it on each of its threads, on average."""
        return self.seconds / len(self.threads)

    @property
    def has_physics(self) -> bool:
        return Activity.PHYSICS in self.activities

    @property
    def waiting_share(self) -> float:
        """The share in which it waits for other processes or threads."""
        return sum(self.activities.get(each, 0.0) for each in WAITING)

    @property
    def is_half_physics(self) -> bool:
        return self.activities.get(Activity.PHYSICS, 0.0) >= 0.5

    @property
    def runs_jax(self) -> bool:
        return self.is_timed(Activity.COMPILING) or self.is_timed(Activity.DISPATCH)

    @property
    def lines_to_step(self) -> Sequence[tuple[str, int]]:
        return [position for call in self.calls if call.is_step for position in call.lines]

    def error(self, share: float) -> float:
        return error_of(share, self.samples)

    def is_timed(self, activity: Activity) -> bool:
        """Whether the share of an activity comes from calls that are timed one by one."""
        return any(call.activity == activity for call in self.calls)


def error_of(share: float, samples: int) -> float:
    """Return the standard error of a share that samples show."""
    return math.sqrt(max(0.0, share * (1 - share)) / max(1, samples))


def large(times: Iterable[LineTime]) -> list[LineTime]:
    large = [time for time in times if time.share >= LEAST_LINE_SHARE]
    return sorted(large, key=lambda time: -time.share)


def shares_of(parts: Iterable[tuple[_Key, float]], total: float | None = None) -> dict[_Key, float]:
    """Return shares of a total by key, largest first; the total is that of all parts if None.

    Of a total of nothing, such as calls that are shorter than what it costs to time them, no part
    has a share.
    """
    seconds: dict[_Key, float] = defaultdict(float)
    for key, part in parts:
        seconds[key] += part
    total = sum(seconds.values()) if total is None else total
    ordered = sorted(seconds.items(), key=lambda item: -item[1])
    return {key: value / total if total else 0.0 for key, value in ordered}
