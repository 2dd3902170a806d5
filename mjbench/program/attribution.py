"""Where the time of a program's stepping loops goes, from samples of its stacks."""

import math
from collections import Counter, defaultdict
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

from mjbench.instrument.bounds import Share
from mjbench.program import activities
from mjbench.program.activities import Activity, Place, is_own
from mjbench.program.calls import CallTime
from mjbench.program.hook.call_clock import COMPILE
from mjbench.program.samples import Frame, ThreadSamples
from mjbench.program.source_loops import SourceLoop, outermost_loop, source_line

# Fewer samples tell little.
FEW_SAMPLES = 30
# Lines with a smaller share of a loop are left out.
LEAST_LINE_SHARE = 0.005
# Where samples saw less than this beside the calls that are timed, they do not divide the rest.
_LEAST_REST = 0.02
# Loops with a smaller share of the time of all loops that step are left out.
LEAST_LOOP_SHARE = 0.05
# The `_bootstrap` of this module begins a process, which may be a fork.
_PROCESS_MODULE = "multiprocessing/process.py"

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
        """Check that it does something.

        Raises:
          ValueError: there is no activity.
        """
        if not self.activities:
            raise ValueError("a line has no activity")

    @property
    def main_activity(self) -> Activity:
        """What takes most of the line's time."""
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
      engine_clock: share of the timer of MuJoCo's Python package.
      calls: of functions that are timed one by one, from lines of this loop.
    """

    loop: SourceLoop
    own_files: Sequence[str]
    threads: Sequence[str]
    pids: Sequence[int]
    in_main: bool
    samples: int
    seconds: float
    activities: Mapping[Activity, Share]
    packages: Mapping[str, Share]
    lines: Sequence[LineTime]
    inner_functions: Sequence[LineTime]
    engine_clock: Share
    calls: Sequence[CallTime] = ()

    @property
    def has_physics(self) -> bool:
        """Whether the engine was seen in it."""
        return Activity.PHYSICS in self.activities

    def error(self, share: float) -> float:
        """Return the standard error of a share, as that of a binomial proportion."""
        return math.sqrt(max(0.0, share * (1 - share)) / max(1, self.samples))

    @property
    def timed_share(self) -> float:
        """The share of calls that are timed one by one."""
        return min(1.0, sum(call.seconds for call in self.calls) / self.seconds)

    def is_timed(self, activity: Activity) -> bool:
        """Whether the share of an activity comes from calls that are timed one by one."""
        return any(call.activity == activity for call in self.calls)


@dataclass(frozen=True)
class _Sample:
    """One stack in a loop, with what it shows."""

    thread: ThreadSamples
    stack: Sequence[Frame]
    loop_frame: int
    activity: Activity | None

    @property
    def seconds(self) -> float:
        """The time that it stands for."""
        return self.thread.interval_s


def loop_times(
    threads: Sequence[ThreadSamples],
    main_pid: int,
    stepping_pids: Collection[int] = (),
    calls: Sequence[CallTime] = (),
    collections_s: Mapping[int, float] | None = None,
) -> list[LoopTime]:
    """Return the loops that step, or wait for processes that do; the program's own first.

    Args:
      threads: samples of all threads of all processes.
      main_pid: the program's first process.
      stepping_pids: processes that are known to step; samples may miss a small share of physics.
      calls: that were timed one by one; they also show loops of which there are no samples.
      collections_s: seconds of garbage collections by process, which samples of Python alone do
        not show.
    """
    by_loop: dict[SourceLoop, list[_Sample]] = defaultdict(list)
    for thread in threads:
        for stack in thread.stacks:
            position = _loop_frame(stack)
            if position is not None:
                frame = stack[position]
                loop = outermost_loop(frame.file, frame.line)
                assert loop is not None, "the frame was chosen because it is in a loop"
                activity = activities.activity(stack, thread.has_native)
                by_loop[loop].append(_Sample(thread, stack, position, activity))
    sampled = [_loop_time(loop, samples, main_pid) for loop, samples in by_loop.items()]
    times = [
        _with_collections(time, sum((collections_s or {}).get(pid, 0.0) for pid in time.pids))
        for time in _with_calls(sampled, calls, main_pid)
    ]
    return sorted(
        _stepping(times, stepping_pids), key=lambda time: (not time.in_main, -time.seconds)
    )


def _with_calls(
    sampled: Sequence[LoopTime], calls: Sequence[CallTime], main_pid: int
) -> list[LoopTime]:
    """Return loops with the calls that were timed in them, and loops that only calls show."""
    by_loop: dict[SourceLoop, list[CallTime]] = defaultdict(list)
    for call in calls:
        if call.loop is not None:
            by_loop[call.loop].append(call)
    times = {time.loop: time for time in sampled}
    for loop, of_loop in by_loop.items():
        if loop in times:
            times[loop] = _timed(times[loop], of_loop)
        elif any(call.is_step or call.callee == COMPILE for call in of_loop):
            times[loop] = _timed(_unsampled(loop, of_loop, main_pid), of_loop)
    return list(times.values())


def _with_collections(time: LoopTime, seconds: float) -> LoopTime:
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

    lines = [(line, rest(line.activities)) for line in time.lines]
    activities_of_loop = {**rest(time.activities), Activity.COLLECTION: share}
    return replace(
        time,
        activities=dict(sorted(activities_of_loop.items(), key=lambda item: -item[1])),
        lines=[replace(line, share=sum(parts.values()), activities=parts) for line, parts in lines],
    )


def _unsampled(loop: SourceLoop, calls: Sequence[CallTime], main_pid: int) -> LoopTime:
    """Return a loop of which there are no samples."""
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
        engine_clock=0.0,
    )


def _span_s(calls: Sequence[CallTime]) -> float:
    """Return the seconds from the first call to the end of the last, summed over threads.

    What the clock took is not the loop's.
    """
    by_thread: dict[tuple[int, int], list[CallTime]] = defaultdict(list)
    for call in calls:
        by_thread[call.pid, call.thread].append(call)
    spans = (
        max(call.last_ns for call in of_thread) - min(call.first_ns for call in of_thread)
        for of_thread in by_thread.values()
    )
    loop_s = sum(spans) * 1e-9 - sum(call.clock_s for call in calls)
    return max(1e-9, loop_s, sum(call.seconds for call in calls))


def _timed(time: LoopTime, calls: Sequence[CallTime]) -> LoopTime:
    """Return a loop with its calls: what they take is known, and samples divide the rest."""
    has_samples = time.samples >= FEW_SAMPLES
    seconds = _span_s(calls)
    timed = _shares((call.activity, call.seconds) for call in calls)
    timed_s = sum(call.seconds for call in calls)
    share = min(1.0, timed_s / seconds)
    exact = {activity: part * share for activity, part in timed.items()}
    slow = {_place_key(c.place) for c in calls if c.activity != Activity.PHYSICS}
    rest = {
        _place_key(line.place): {
            activity: part
            for activity, part in line.activities.items()
            if activity not in exact and _place_key(line.place) not in slow
        }
        for line in time.lines
    }
    rest_by_activity: dict[Activity, float] = defaultdict(float)
    for activity, part in time.activities.items():
        if activity not in exact:
            on_slow_lines = sum(
                line.activities.get(activity, 0.0)
                for line in time.lines
                if _place_key(line.place) in slow
            )
            rest_by_activity[activity] = max(0.0, part - on_slow_lines)
    total_rest = sum(rest_by_activity.values())
    if has_samples and total_rest > _LEAST_REST:
        factor = (1 - share) / total_rest
        others = {activity: part * factor for activity, part in rest_by_activity.items()}
    else:
        # samples that are all on the lines of these calls saw the calls themselves
        rest_is = Activity.BINDINGS if has_samples else Activity.REST
        factor, others = 0.0, {rest_is: 1 - share}
    parts = {**exact, **{activity: part for activity, part in others.items() if part > 1e-6}}
    return replace(
        time,
        seconds=seconds,
        own_files=sorted({*time.own_files, *(call.place.file for call in calls)}),
        activities=dict(sorted(parts.items(), key=lambda item: -item[1])),
        packages={
            name: part / time.activities[Activity.PYTHON] * parts.get(Activity.PYTHON, 0.0)
            for name, part in time.packages.items()
        },
        lines=_timed_lines(time, calls, seconds, rest, factor),
        inner_functions=[
            replace(
                line,
                share=line.share * factor,
                activities={each: part * factor for each, part in line.activities.items()},
            )
            for line in time.inner_functions
            if factor and line.main_activity not in exact
        ],
        calls=calls,
    )


def _timed_lines(
    time: LoopTime,
    calls: Sequence[CallTime],
    seconds: float,
    rest: Mapping[tuple[str, int], Mapping[Activity, float]],
    factor: float,
) -> list[LineTime]:
    """Return the lines of a loop: their timed calls, and what samples saw of them beside those."""
    places = {_place_key(line.place): line.place for line in time.lines}
    packages = {_place_key(line.place): line.package for line in time.lines}
    parts: dict[tuple[str, int], list[tuple[Activity, float]]] = defaultdict(list)
    for call in calls:
        places.setdefault(_place_key(call.place), call.place)
        parts[_place_key(call.place)].append((call.activity, call.seconds / seconds))
    for key, activities_of_line in rest.items():
        parts[key] += [(each, part * factor) for each, part in activities_of_line.items()]
    lines = []
    for key, of_line in parts.items():
        shares = _shares(of_line, 1.0)
        if shares:
            share = min(1.0, sum(shares.values()))
            lines.append(LineTime(places[key], share, shares, packages.get(key, "")))
    return _large(lines)


def _place_key(place: Place) -> tuple[str, int]:
    return place.file, place.line


def _stepping(times: Sequence[LoopTime], pids: Collection[int]) -> list[LoopTime]:
    """Return the loops that step, but short ones; with those that wait while other processes do."""
    stepping = [time for time in times if time.has_physics or time.is_timed(Activity.COMPILING)]
    seen = {pid for time in stepping for pid in time.pids}
    for pid in sorted(set(pids) - seen):
        of_process = [time for time in times if pid in time.pids]
        longest = max(of_process, key=lambda time: time.seconds, default=None)
        if longest is not None and longest.samples >= FEW_SAMPLES and longest not in stepping:
            stepping.append(longest)
    elsewhere = any(not time.in_main for time in stepping)
    waiting = [
        time
        for time in times
        if not time.has_physics
        and elsewhere
        and Activity.PROCESSES in time.activities
        and time.in_main
    ]
    total_s = sum(time.seconds for time in stepping + waiting)
    return [time for time in stepping + waiting if time.seconds >= LEAST_LOOP_SHARE * total_s]


def _loop_frame(stack: Sequence[Frame]) -> int | None:
    """Return which frame of a stack runs its outermost loop; None where none does.

    Loops of Python's standard library are not meant: they start threads and processes. Nor are
    those of the process that forked this one, which stand on its stack.
    """
    begin = _own_begin(stack)
    for i, frame in enumerate(stack):
        if i < begin:
            continue
        if not frame.is_python or frame.file.startswith("<") or activities.is_step_clock(frame):
            continue
        if activities.standard_name(frame.file):
            continue
        if outermost_loop(frame.file, frame.line) is not None:
            return i
    return None


def _own_begin(stack: Sequence[Frame]) -> int:
    """Return where the frames of a process begin, behind those of the one that forked it."""
    begins = [
        i + 1
        for i, frame in enumerate(stack)
        if activities.standard_name(frame.file) == _PROCESS_MODULE
        and frame.function.endswith("_bootstrap")
    ]
    return begins[-1] if begins else 0


def _loop_time(loop: SourceLoop, samples: Sequence[_Sample], main_pid: int) -> LoopTime:
    resolved = _resolved(samples)
    by_activity = _shares((activity, sample.seconds) for sample, activity in resolved)
    total_s = sum(sample.seconds for sample in samples)
    packages = _shares(
        (
            (activities.package_of(_innermost_python(sample).file), sample.seconds)
            for sample, activity in resolved
            if activity == Activity.PYTHON
        ),
        total_s,
    )
    clock_s = sum(
        sample.seconds
        for sample, activity in resolved
        if activity == Activity.PHYSICS and activities.is_engine_clock(sample.stack)
    )
    threads = {sample.thread.thread: sample.thread.thread.name for sample in samples}
    return LoopTime(
        loop=SourceLoop(activities.shown_path(loop.file), loop.first, loop.last),
        own_files=sorted(
            {
                activities.shown_path(frame.file)
                for sample in samples
                for frame in _inner(sample)
                if is_own(frame)
            }
        ),
        threads=sorted(threads.values()),
        pids=sorted({thread.pid for thread in threads}),
        in_main=any(thread.pid == main_pid == thread.tid for thread in threads),
        samples=round(total_s**2 / sum(sample.seconds**2 for sample in samples)),
        seconds=total_s,
        activities=by_activity,
        packages=packages,
        lines=_own_lines(resolved),
        inner_functions=_inner_functions(resolved),
        engine_clock=clock_s / total_s,
    )


def _resolved(samples: Sequence[_Sample]) -> list[tuple[_Sample, Activity]]:
    """Return each sample with its activity.

    What a sample in a library such as that of C shows depends on who called it, which the stack may
    not hold. It counts for what other samples of its line show, most often.
    """
    at_line: dict[tuple[str, int], Counter[Activity]] = defaultdict(Counter)
    for sample in samples:
        if sample.activity is not None:
            at_line[_line(sample)][sample.activity] += 1
    resolved = []
    for sample in samples:
        activity = sample.activity
        if activity is None:
            others = at_line[_line(sample)].most_common(1)
            activity = others[0][0] if others else Activity.PYTHON
        resolved.append((sample, activity))
    return resolved


def _line(sample: _Sample) -> tuple[str, int]:
    frame = _innermost_python(sample)
    return frame.file, frame.line


def _innermost_python(sample: _Sample) -> Frame:
    """Return the innermost line of Python that is not the step clock's."""
    lines = (frame for frame in reversed(sample.stack) if frame.is_python)
    return next(frame for frame in lines if not activities.is_step_clock(frame))


def _own_lines(resolved: Sequence[tuple[_Sample, Activity]]) -> list[LineTime]:
    """Return the lines of the user's code, each with the package that it calls most."""
    total_s = sum(sample.seconds for sample, _ in resolved)
    seconds: dict[Place, list[tuple[Activity, float]]] = defaultdict(list)
    packages: dict[Place, Counter[str]] = defaultdict(Counter)
    for sample, activity in resolved:
        frame = _own_frame(sample)
        place = _shown_place(frame.file, frame.line, frame.function)
        seconds[place].append((activity, sample.seconds))
        if activity != Activity.PHYSICS:
            packages[place][_called_package(sample, frame)] += 1
    times = []
    for place, parts in seconds.items():
        shares = _shares(parts, total_s)
        package = packages[place].most_common(1)[0][0] if packages[place] else ""
        times.append(LineTime(place, sum(shares.values()), shares, package))
    return _large(times)


def _called_package(sample: _Sample, own: Frame) -> str:
    """Return the installed package that a line of the user's code calls; "" for none."""
    inner = list(_inner(sample))
    following = inner[len(inner) - inner[::-1].index(own) :]
    packages = (activities.package_of(frame.file) for frame in following if frame.is_python)
    return next((name for name in packages if name), "")


def _inner_functions(resolved: Sequence[tuple[_Sample, Activity]]) -> list[LineTime]:
    """Return the functions of installed packages that samples were in, physics aside."""
    total_s = sum(sample.seconds for sample, _ in resolved)
    functions: dict[tuple[str, str], list[tuple[Activity, float]]] = defaultdict(list)
    lines: dict[tuple[str, str], Counter[int]] = defaultdict(Counter)
    for sample, activity in resolved:
        frame = _innermost_python(sample)
        if activity != Activity.PHYSICS and activities.package_of(frame.file):
            functions[frame.file, frame.function].append((activity, sample.seconds))
            lines[frame.file, frame.function][frame.line] += 1
    times = []
    for (file, function), seconds in functions.items():
        line = lines[file, function].most_common(1)[0][0]
        place = Place(activities.shown_path(file), line, function, f"{function}()")
        parts = _shares(seconds, total_s)
        times.append(LineTime(place, sum(parts.values()), parts))
    return _large(times)


def _large(times: Iterable[LineTime]) -> list[LineTime]:
    """Return what takes a share that is worth a line, largest first."""
    large = [time for time in times if time.share >= LEAST_LINE_SHARE]
    return sorted(large, key=lambda time: -time.share)


def _shares(parts: Iterable[tuple[_Key, float]], total: float | None = None) -> dict[_Key, float]:
    """Return shares of a total by key, largest first; the total is that of all parts if None."""
    seconds: dict[_Key, float] = defaultdict(float)
    for key, part in parts:
        seconds[key] += part
    total = sum(seconds.values()) if total is None else total
    ordered = sorted(seconds.items(), key=lambda item: -item[1])
    return {key: value / total for key, value in ordered}


def _inner(sample: _Sample) -> Sequence[Frame]:
    """Return the frames of a sample from the loop inward."""
    return sample.stack[sample.loop_frame :]


def _shown_place(file: str, line: int, function: str) -> Place:
    return Place(activities.shown_path(file), line, function, source_line(file, line))


def _own_frame(sample: _Sample) -> Frame:
    """Return the innermost line of the user's code; that of the loop where none is."""
    inner = _inner(sample)
    own = [frame for frame in inner if is_own(frame)]
    return own[-1] if own else inner[0]
