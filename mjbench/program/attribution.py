"""Where the time of a program's stepping loops goes, from samples of its stacks."""

import itertools
from collections import Counter, defaultdict
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

from mjbench.program import activities, timed_loops
from mjbench.program.activities import WAITING, Activity, Place, is_own
from mjbench.program.calls import CallTime
from mjbench.program.loop_time import (
    FEW_SAMPLES,
    LEAST_REPEATS,
    LineTime,
    LoopTime,
    large,
    shares_of,
)
from mjbench.program.samples import Frame, Thread, ThreadSamples
from mjbench.program.source_loops import SourceLoop, outermost_loop

# Loops with a smaller share of the time of all loops that step are left out.
LEAST_LOOP_SHARE = 0.05
# Share of a line's samples that may show a step that it does not make; of a few, one sample may.
_MOST_TORN_SHARE, _FEW_TORN_SHARE = 0.05, 0.25
# Average gaps between timed calls that may lie beyond the first and the last by chance: more do in
# 4 % of the cases, if the gaps are exponentially distributed. Times that samples must see calls.
_MOST_CHANCE_GAPS, _LEAST_RUNS = 5, 10


@dataclass(frozen=True)
class _Sample:
    thread: ThreadSamples
    stack: Sequence[Frame]
    loop_frame: int
    activity: Activity | None

    @property
    def seconds(self) -> float:
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
      stepping_pids: processes that are known to step; samples may miss a small share of physics.
      calls: that were timed one by one; they also show loops of which there are no samples.
      collections_s: seconds of garbage collections by process, which samples of Python alone do
        not show.
    """
    by_loop: dict[SourceLoop, list[_Sample]] = defaultdict(list)
    of_pools = {
        each.thread.pid for each in threads if any(map(activities.is_of_thread_pool, each.stacks))
    }
    for thread in threads:
        has_pool = thread.thread.pid in of_pools
        for stack in thread.stacks:
            position = _loop_frame(stack)
            if position is not None:
                loop = _shown_loop(stack[position])
                assert loop is not None, "the frame was chosen because it is in a loop"
                activity = activities.activity(stack, thread.has_native, has_pool)
                by_loop[loop].append(_Sample(thread, stack, position, activity))
    loading = _loading_lines(calls)
    sampled = [_loop_time(loop, samples, main_pid, loading) for loop, samples in by_loop.items()]
    timed = {call.place.position for call in calls}
    stretches = {loop: _stretch(samples, timed) for loop, samples in by_loop.items()}
    times = [
        timed_loops.with_collections(
            time, sum((collections_s or {}).get(pid, 0.0) for pid in time.pids)
        )
        for time in timed_loops.with_calls(sampled, calls, main_pid, stretches)
    ]
    return sorted(
        _stepping(times, stepping_pids), key=lambda time: (not time.in_main, -time.seconds)
    )


def outside_loops(
    threads: Sequence[ThreadSamples],
    main_pid: int,
    loops: Sequence[LoopTime],
    wall_s: float,
    calls: Sequence[CallTime] = (),
) -> list[LineTime]:
    """Return the lines of the main thread that take time outside loops, as shares of `wall_s`.

    Each is the outermost line on its stacks that is on none of a loop: it stands for all that it
    calls, such as `main_model = build()`. What a line imports, or lets JAX compile, is an
    activity of its own.
    """
    of_loops = {time.loop for time in loops}
    on_loops: set[Place] = set()
    rest: list[tuple[list[Place], Activity, float]] = []
    for thread in threads:
        if not thread.thread.pid == main_pid == thread.thread.tid:
            continue
        for stack in thread.stacks:
            places = _shown_places(stack)
            if not loops:  # what the module calls is the program itself
                on_loops.update(places[:-1][:1])
            position = _loop_frame(stack)
            loop = None if position is None else _shown_loop(stack[position])
            if loop in of_loops:
                on_loops.update(places)
            else:
                rest.append((places, _outside_activity(stack, thread), thread.interval_s))
    compiling = {call.place.position for call in calls if call.activity == Activity.COMPILING}
    seconds: dict[Place, list[tuple[Activity, float]]] = defaultdict(list)
    for places, activity, interval_s in rest:
        place = next((each for each in places if each not in on_loops), None)
        if place is not None:
            is_compiling = any(each.position in compiling for each in places)
            seconds[place].append((Activity.COMPILING if is_compiling else activity, interval_s))
    return large(LineTime.of(place, parts, wall_s) for place, parts in seconds.items())


def _outside_activity(stack: Sequence[Frame], thread: ThreadSamples) -> Activity:
    """Return what a stack outside loops shows; all that a module does when imported is imports."""
    if any(activities.imports(frame) for frame in stack):
        return Activity.IMPORT
    return activities.activity(stack, thread.has_native) or Activity.PYTHON


def _stepping(times: Sequence[LoopTime], pids: Collection[int]) -> list[LoopTime]:
    """Return the loops that step, but short ones; with those that wait while other processes do."""
    stepping = [time for time in times if time.has_physics or time.runs_jax]
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
        and not {*WAITING, Activity.STARTING}.isdisjoint(time.activities)
        and time.in_main
        and not _waits_for_ends(time)
    ]
    total_s = sum(time.seconds for time in stepping + waiting)
    return [time for time in stepping + waiting if time.seconds >= LEAST_LOOP_SHARE * total_s]


def _waits_for_ends(time: LoopTime) -> bool:
    """Return whether a loop waits for processes or threads to end, whose own loops then count."""

    def waiting(line: LineTime) -> float:
        return sum(line.activities.get(each, 0.0) for each in WAITING)

    longest = max(time.lines, key=waiting, default=None)
    return longest is not None and waiting(longest) > 0 and ".join(" in longest.place.text


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


def _shown_loop(frame: Frame) -> SourceLoop | None:
    loop = outermost_loop(frame.file, frame.line)
    return None if loop is None else replace(loop, file=activities.shown_path(loop.file))


def _own_begin(stack: Sequence[Frame]) -> int:
    """Return where the frames of a process begin, behind those of the one that forked it."""
    begins = [
        i + 1
        for i, frame in enumerate(stack)
        if activities.standard_name(frame.file) == activities.PROCESS_MODULE
        and frame.function.endswith("_bootstrap")
    ]
    return begins[-1] if begins else 0


def _stretch(samples: Sequence[_Sample], timed: Collection[tuple[str, int]]) -> float | None:
    """Return the time of a loop over the time from its first timed call to its last, by samples.

    Only the order of samples counts: how long each stands for is uncertain in a short program. It
    is 1 where those before the first call and after the last may be there by chance, and None where
    samples saw too few calls.

    Args:
      samples: of the loop, by thread, in the order in which they were taken.
    """
    by_thread: dict[Thread, list[tuple[float, bool]]] = defaultdict(list)
    for sample in samples:
        is_timed = any((each.file, each.line) in timed for each in _own_places(sample))
        by_thread[sample.thread.thread].append((sample.seconds, is_timed))
    beyond_s = between_s = 0.0
    for of_thread in by_thread.values():
        hits = [i for i, (_, is_timed) in enumerate(of_thread) if is_timed]
        runs = sum(before + 1 < i for before, i in itertools.pairwise(hits)) + len(hits[:1])
        total_s = sum(seconds for seconds, _ in of_thread)
        within_s = sum(seconds for seconds, _ in of_thread[hits[0] : hits[-1] + 1]) if hits else 0.0
        is_always = len(hits) == len(of_thread)
        if runs < _LEAST_RUNS and not is_always:
            return None
        between_s += within_s
        if total_s - within_s > _MOST_CHANCE_GAPS / runs * total_s:
            beyond_s += total_s - within_s
    return 1 + beyond_s / between_s


def _loading_lines(calls: Sequence[CallTime]) -> set[tuple[str, int]]:
    counts: dict[tuple[str, int], float] = defaultdict(float)
    for call in calls:
        if call.activity == Activity.LOADING:
            counts[call.place.position] += call.calls
    return {line for line, count in counts.items() if count >= LEAST_REPEATS}


def _loop_time(
    loop: SourceLoop,
    samples: Sequence[_Sample],
    main_pid: int,
    loading: Collection[tuple[str, int]],
) -> LoopTime:
    resolved = _resolved(samples)
    by_activity = shares_of((activity, sample.seconds) for sample, activity in resolved)
    total_s = sum(sample.seconds for sample in samples)
    packages = shares_of(
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
        loop=loop,
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
        building=_building_line(resolved, loading),
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
    places: dict[tuple[str, int], Place] = {}
    seconds: dict[tuple[str, int], list[tuple[Activity, float]]] = defaultdict(list)
    packages: dict[tuple[str, int], Counter[str]] = defaultdict(Counter)
    for sample, activity in resolved:
        frame = _own_frame(sample)
        place = activities.place_of(frame)
        if place.position not in places or not place.function.startswith("<"):
            places[place.position] = place
        seconds[place.position].append((activity, sample.seconds))
        if activity != Activity.PHYSICS:
            packages[place.position][_called_package(sample, frame)] += 1
    times = []
    for position, parts in seconds.items():
        package = next((name for name, _ in packages[position].most_common(1)), "")
        times.append(LineTime.of(places[position], parts, total_s, package))
    return large(times)


def _building_line(
    resolved: Sequence[tuple[_Sample, Activity]], loading: Collection[tuple[str, int]]
) -> LineTime | None:
    """Return the outermost line under which models are built or loaded, and nothing steps.

    Where there are several, it is that with most of their time, and has the time of all.
    """
    total_s = sum(sample.seconds for sample, _ in resolved)
    seconds: dict[Place, list[float]] = defaultdict(list)
    steps_s: dict[Place, float] = defaultdict(float)
    for sample, activity in resolved:
        is_slow_call = sample.stack[-1].file.endswith(activities.CALL_CLOCK)
        for place in _own_places(sample):
            seconds[place].append(sample.seconds)
            if activity == Activity.PHYSICS and not is_slow_call:
                steps_s[place] += sample.seconds
    # a torn stack may show a step under another line
    without_steps = {
        place for place, parts in seconds.items() if steps_s[place] < _most_torn_s(parts)
    }
    by_outermost: dict[Place, list[tuple[Activity, float]]] = defaultdict(list)
    built_s: dict[Place, float] = defaultdict(float)
    for sample, activity in resolved:
        places = _own_places(sample)
        outermost = next((each for each in places if each in without_steps), None)
        if outermost is None:
            continue
        loads = [(each.file, each.line) in loading for each in places]
        by_outermost[outermost].append(
            (Activity.LOADING if loads[-1] else activity, sample.seconds)
        )
        if activity == Activity.BUILDING or any(loads):
            built_s[outermost] += sample.seconds
    if not built_s:
        return None
    place = max(built_s, key=lambda each: built_s[each])
    of_places = [
        part
        for each, own_built_s in built_s.items()
        if each == place or 2 * own_built_s >= sum(part_s for _, part_s in by_outermost[each])
        for part in by_outermost[each]
    ]
    return LineTime.of(place, of_places, total_s)


def _most_torn_s(seconds: Sequence[float]) -> float:
    """Return the time of a line's samples that may show a step that it does not make."""
    one_s = min(1.5 * max(seconds), _FEW_TORN_SHARE * sum(seconds))
    return max(one_s, _MOST_TORN_SHARE * sum(seconds))


def _own_places(sample: _Sample) -> list[Place]:
    return _shown_places(_inner(sample))


def _shown_places(stack: Sequence[Frame]) -> list[Place]:
    own = [frame for frame in stack if is_own(frame)]
    return list(dict.fromkeys(map(activities.place_of, own)))


def _called_package(sample: _Sample, own: Frame) -> str:
    inner = list(_inner(sample))
    following = inner[len(inner) - inner[::-1].index(own) :]
    packages = (activities.package_of(frame.file) for frame in following if frame.is_python)
    return next((name for name in packages if name), "")


def _inner_functions(resolved: Sequence[tuple[_Sample, Activity]]) -> list[LineTime]:
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
        times.append(LineTime.of(place, seconds, total_s))
    return large(times)


def _inner(sample: _Sample) -> Sequence[Frame]:
    return sample.stack[sample.loop_frame :]


def _own_frame(sample: _Sample) -> Frame:
    """Return the innermost line of the user's code; that of the loop where none is."""
    inner = _inner(sample)
    own = [frame for frame in inner if is_own(frame)]
    return own[-1] if own else inner[0]
