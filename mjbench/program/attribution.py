"""Where the time of a program's stepping loops goes, from samples of its stacks."""

import math
from collections import Counter, defaultdict
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

from mjbench.instrument.bounds import Share
from mjbench.program import activities
from mjbench.program.activities import Activity, Place, is_own
from mjbench.program.samples import Frame, ThreadSamples
from mjbench.program.source_loops import SourceLoop, outermost_loop, source_line

# Fewer samples tell little.
FEW_SAMPLES = 30
# Lines with a smaller share of a loop are left out.
LEAST_LINE_SHARE = 0.005
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

    @property
    def has_physics(self) -> bool:
        """Whether the engine was seen in it."""
        return Activity.PHYSICS in self.activities

    def error(self, share: float) -> float:
        """Return the standard error of a share, as that of a binomial proportion."""
        return math.sqrt(max(0.0, share * (1 - share)) / max(1, self.samples))


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
    threads: Sequence[ThreadSamples], main_pid: int, stepping_pids: Collection[int] = ()
) -> list[LoopTime]:
    """Return the loops that step, or wait for processes that do; the program's own first.

    Args:
      threads: samples of all threads of all processes.
      main_pid: the program's first process.
      stepping_pids: processes that are known to step; samples may miss a small share of physics.
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
    times = [_loop_time(loop, samples, main_pid) for loop, samples in by_loop.items()]
    return sorted(
        _stepping(times, stepping_pids), key=lambda time: (not time.in_main, -time.seconds)
    )


def _stepping(times: Sequence[LoopTime], pids: Collection[int]) -> list[LoopTime]:
    """Return the loops that step, but short ones; with those that wait while other processes do."""
    stepping = [time for time in times if time.has_physics]
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
