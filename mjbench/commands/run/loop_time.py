"""Where the time of one loop goes: samples divide what the calls that were timed in it leave."""

import math
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

from mjbench.bounds import NonNegativeInt, PositiveFloat, Share
from mjbench.commands.run.activities import WAITING, Activity, Place
from mjbench.commands.run.call_times import CallTime
from mjbench.commands.run.hook.call_clock import COMPILE, DISPATCH, PROCESS_START
from mjbench.commands.run.source_loops import SourceLoop

# Fewer samples tell little.
FEW_SAMPLES = 30
# A loop of which physics takes this much has little else to change.
MOSTLY_PHYSICS = 0.8
# A call in a loop that is made less often than this belongs to the set-up.
LEAST_REPEATS = 3
# Lines with a smaller share of a loop are left out.
LEAST_LINE_SHARE = 0.005

# Where samples saw a loop for this many times as long as its calls span, they say how long it runs.
_LEAST_BEYOND = 1.1
# Calls that show a loop, of which there may be no samples, beside those that step.
_SHOWN = (COMPILE, DISPATCH, PROCESS_START)
# What samples show of a line that calls what is timed: its own text may tell it.
_KNOWN_BY_LINE = {Activity.PHYSICS, Activity.PYTHON, Activity.BINDINGS, Activity.NUMPY}
# Where samples saw less than this beside the calls that are timed, they do not divide the rest.
_LEAST_REST = 0.02
# Smaller shares are differences of rounded numbers.
_LEAST_CELL = 1e-6

_Key = TypeVar("_Key")
# A line of the user's code, None for what no line shows; and what is done there.
_Cell = tuple[tuple[str, int] | None, Activity]


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

    def with_activities(self, parts: Mapping[Activity, float]) -> "LineTime":
        return replace(self, share=min(1.0, sum(parts.values())), activities=parts)

    @property
    def main_activity(self) -> Activity:
        return max(self.activities, key=lambda activity: self.activities[activity])


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
      packages: share of `Python` by installed package, largest first; the user's own code has
        the name "".
      lines: of the user's code, with all that they call, by share.
      inner_functions: of installed packages, without what they call in Python and without physics,
        by share; the place of each is the line that samples saw most often.
      calls: of functions that are timed one by one, from lines of this loop.
      building: the outermost line under which models are built or loaded, and nothing steps; of
        several, that which builds most, with the time of all. None without one.
    """

    loop: SourceLoop
    own_files: Sequence[str]
    threads: Sequence[str]
    pids: Sequence[NonNegativeInt]
    in_main: bool
    samples: NonNegativeInt
    seconds: PositiveFloat
    activities: Mapping[Activity, Share]
    packages: Mapping[str, Share]
    lines: Sequence[LineTime]
    inner_functions: Sequence[LineTime]
    calls: Sequence[CallTime] = ()
    building: LineTime | None = None

    @property
    def has_physics(self) -> bool:
        return Activity.PHYSICS in self.activities

    @property
    def waiting_share(self) -> float:
        """The share in which it waits for other processes or threads."""
        return sum(self.activities.get(each, 0.0) for each in WAITING)

    @property
    def is_mostly_physics(self) -> bool:
        return self.activities.get(Activity.PHYSICS, 0.0) >= MOSTLY_PHYSICS

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
        return math.sqrt(max(0.0, share * (1 - share)) / max(1, self.samples))

    def is_timed(self, activity: Activity) -> bool:
        """Whether the share of an activity comes from calls that are timed one by one."""
        return any(call.activity == activity for call in self.calls)


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


def with_calls(
    sampled: Sequence[LoopTime],
    calls: Sequence[CallTime],
    main_pid: int,
    stretches: Mapping[SourceLoop, float | None],
) -> list[LoopTime]:
    """Return loops with the calls that were timed in them, and loops that only calls show.

    Args:
      stretches: of each sampled loop, its time over that from its first timed call to its last;
        None where samples saw too few calls.
    """
    by_loop: dict[SourceLoop, list[CallTime]] = defaultdict(list)
    for call in calls:
        if call.loop is not None:
            by_loop[call.loop].append(call)
    times = {time.loop: time for time in sampled}
    for loop, of_loop in by_loop.items():
        if loop in times:
            times[loop] = _timed(times[loop], of_loop, stretches[loop])
        elif any(call.is_step or call.callee in _SHOWN for call in of_loop):
            times[loop] = _timed(_unsampled(loop, of_loop, main_pid), of_loop)
    return list(times.values())


def with_collections(time: LoopTime, seconds: float) -> LoopTime:
    """Return a loop whose garbage collections are an activity of their own.

    They may begin on any line that creates an object; calls that are timed hold few of them.
    """
    sampled = sum(share for each, share in time.activities.items() if not time.is_timed(each))
    share = min(sampled, seconds / time.seconds)
    if Activity.COLLECTION in time.activities or not share > 0:
        return time

    def rest(parts: Mapping[Activity, float]) -> dict[Activity, float]:
        left = 1 - share / sampled
        return {each: part * (1 if time.is_timed(each) else left) for each, part in parts.items()}

    activities_of_loop = {**rest(time.activities), Activity.COLLECTION: share}
    return replace(
        time,
        activities=shares_of(activities_of_loop.items(), 1.0),
        lines=[line.with_activities(rest(line.activities)) for line in time.lines],
    )


def _unsampled(loop: SourceLoop, calls: Sequence[CallTime], main_pid: int) -> LoopTime:
    pids = sorted({call.pid for call in calls})
    return LoopTime(
        loop=loop,
        own_files=sorted({call.place.file for call in calls}),
        threads=["MainThread"],
        pids=pids,
        in_main=main_pid in pids,
        samples=0,
        seconds=_span_s(calls),
        activities={},
        packages={},
        lines=[],
        inner_functions=[],
    )


def _span_s(calls: Sequence[CallTime]) -> float:
    """Return the seconds from the first call to the end of the last, over all threads."""
    by_thread: dict[tuple[int, int], list[CallTime]] = defaultdict(list)
    for call in calls:
        by_thread[call.pid, call.thread].append(call)
    spans = (
        max(call.last_ns for call in of_thread) - min(call.first_ns for call in of_thread)
        for of_thread in by_thread.values()
    )
    loop_s = sum(spans) * 1e-9 - sum(call.clock_s for call in calls)
    return max(1e-9, loop_s, sum(call.seconds for call in calls))


def _timed(time: LoopTime, calls: Sequence[CallTime], stretch: float | None = 1.0) -> LoopTime:
    has_samples = time.samples >= FEW_SAMPLES
    seconds = _span_s(calls)
    if has_samples and stretch is not None:
        seconds *= stretch
    elif has_samples and time.seconds > _LEAST_BEYOND * seconds:
        seconds = time.seconds  # it also runs without these calls
    exact: dict[_Cell, float] = shares_of(
        (((call.place.position, call.activity), call.seconds) for call in calls), seconds
    )
    left = 1 - min(1.0, sum(call.seconds for call in calls) / seconds)
    sampled = _sampled_beside(time, exact)
    sampled_share = sum(sampled.values())
    if has_samples and sampled_share > _LEAST_REST:
        factor = left / sampled_share
        rest = {cell: part * factor for cell, part in sampled.items()}
    else:
        # samples that are all on the lines of these calls saw the calls themselves
        factor, rest = 0.0, {(None, Activity.BINDINGS if has_samples else Activity.REST): left}
    timed = {activity for _, activity in exact}
    table = [*exact.items(), *(item for item in rest.items() if item[1] > _LEAST_CELL)]
    activities = shares_of(((activity, part) for (_, activity), part in table), 1.0)
    return replace(
        time,
        seconds=seconds,
        own_files=sorted({*time.own_files, *(call.place.file for call in calls)}),
        activities=activities,
        packages={
            name: part / time.activities[Activity.PYTHON] * activities.get(Activity.PYTHON, 0.0)
            for name, part in time.packages.items()
        },
        lines=_lines(time, calls, table),
        inner_functions=[
            line.with_activities({each: part * factor for each, part in line.activities.items()})
            for line in time.inner_functions
            if factor and line.main_activity not in timed
        ],
        calls=calls,
        building=_building(time.building, exact, rest, factor),
    )


def _sampled_beside(time: LoopTime, exact: Mapping[_Cell, float]) -> dict[_Cell, float]:
    """Return the shares that samples show of what is not timed.

    On the line of a timed call that is no step, samples may see the call itself as Python or NumPy:
    what they see beyond its time makes the call, or frees its result.
    """
    timed = {activity for _, activity in exact}
    slow = shares_of(
        ((line, part) for (line, each), part in exact.items() if each != Activity.PHYSICS), 1.0
    )
    known = {*_KNOWN_BY_LINE, *timed}
    if Activity.DISPATCH in timed:
        known.add(Activity.POLICY)  # JAX itself, where it is called
    cells: dict[_Cell, float] = {}
    on_no_line = defaultdict[Activity, float](float, time.activities)
    for line in time.lines:
        position, parts = line.place.position, dict(line.activities)
        for activity, part in parts.items():
            on_no_line[activity] -= part
        if position in slow:
            parts = {each: part for each, part in parts.items() if each not in known}
            beside = line.share - slow[position] - sum(parts.values())
            if beside > 2 * time.error(line.share):
                parts[Activity.BINDINGS] = beside
        cells.update({(position, each): part for each, part in parts.items()})
    cells.update({(None, each): max(0.0, part) for each, part in on_no_line.items()})
    return {cell: part for cell, part in cells.items() if cell[1] not in timed}


def _lines(
    time: LoopTime, calls: Sequence[CallTime], table: Iterable[tuple[_Cell, float]]
) -> list[LineTime]:
    places = {call.place.position: call.place for call in reversed(calls)}
    places |= {line.place.position: line.place for line in time.lines}
    packages = {line.place.position: line.package for line in time.lines}
    parts: dict[tuple[str, int], list[tuple[Activity, float]]] = defaultdict(list)
    for (position, activity), part in table:
        if position is not None:
            parts[position].append((activity, part))
    return large(
        LineTime.of(places[position], of_line, 1.0, packages.get(position, ""))
        for position, of_line in parts.items()
    )


def _building(
    line: LineTime | None, exact: Mapping[_Cell, float], rest: Mapping[_Cell, float], factor: float
) -> LineTime | None:
    """Return the line under which models are built, with the timed calls that load them.

    Args:
      factor: by which samples of what is not timed are scaled; 0 where they do not count.
    """
    if line is None:
        return None
    timed = {activity for _, activity in exact}
    parts = {each: part * factor for each, part in line.activities.items() if each not in timed}
    loading = {cell: part for cell, part in exact.items() if cell[1] == Activity.LOADING}
    parts[Activity.LOADING] = loading_share = sum(loading.values())
    if factor:
        beside = sum(rest.get((position, Activity.BINDINGS), 0.0) for position, _ in loading)
    else:
        slow = sum(part for (_, each), part in exact.items() if each != Activity.PHYSICS)
        beside = sum(rest.values()) * loading_share / max(1e-9, slow)
    parts[Activity.BINDINGS] = parts.get(Activity.BINDINGS, 0.0) + beside
    return line.with_activities(parts)
