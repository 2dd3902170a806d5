"""Where the time of a program's stepping loops goes, from samples of its stacks."""

import itertools
from collections import Counter, defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from mjbench.commands.run import activities, loop_time
from mjbench.commands.run.activities import WAITING, Activity, Place, is_own
from mjbench.commands.run.call_times import CallTime
from mjbench.commands.run.hook import file_owners
from mjbench.commands.run.loop_time import (
    FEW_SAMPLES,
    LEAST_REPEATS,
    LineTime,
    LoopTime,
    large,
    shares_of,
)
from mjbench.commands.run.py_spy import Frame, Thread, ThreadSamples
from mjbench.commands.run.source_loops import SourceLoop, program_loop

# Loops with a smaller share of the time of all loops that step are left out.
LEAST_LOOP_SHARE = 0.05
# Share of a line's samples that may show a step that it does not make; of a few, one sample may.
_MOST_TORN_SHARE, _FEW_TORN_SHARE = 0.05, 0.25
# Average gaps between timed calls that may lie beyond the first and the last by chance: more do in
# 4 % of the cases, if the gaps are exponentially distributed. Times that samples must see calls.
_MOST_CHANCE_GAPS, _LEAST_RUNS = 5, 10


@dataclass(frozen=True)
class _Sample:
    """A stack of a loop; `inner` are its frames from the line of the loop on."""

    thread: ThreadSamples
    stack: Sequence[Frame]
    inner: Sequence[Frame]
    activity: Activity

    @property
    def seconds(self) -> float:
        return self.thread.interval_s

    @cached_property
    def python(self) -> Frame:
        return next(frame for frame in reversed(self.stack) if not activities.is_step_clock(frame))

    @cached_property
    def own_places(self) -> Sequence[Place]:
        return _shown_places(self.inner)

    @property
    def own_frame(self) -> Frame:
        """The innermost line of the user's code; that of the loop where none is."""
        own = (frame for frame in reversed(self.inner) if is_own(frame))
        return next(own, self.inner[0])


# A stack of a loop, before what it does is known: of which thread, its frames, and the inner ones.
_Stack = tuple[ThreadSamples, Sequence[Frame], Sequence[Frame]]


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
    by_loop: dict[SourceLoop, list[_Stack]] = defaultdict(list)
    for thread in threads:
        for stack in thread.stacks:
            if (running := _outermost_loop(stack)) is not None:
                loop, inner = running
                by_loop[loop].append((thread, stack, inner))
    of_pools = {
        each.thread.pid for each in threads if any(map(activities.is_of_thread_pool, each.stacks))
    }
    samples = {loop: _samples(of_loop, of_pools) for loop, of_loop in by_loop.items()}
    loading = _loading_lines(calls)
    sampled = [
        _loop_time(loop, of_loop, main_pid, loading, _lines_of_jax(calls, loop))
        for loop, of_loop in samples.items()
    ]
    timed = {call.place.position for call in calls}
    stretches = {loop: _stretch(of_loop, timed) for loop, of_loop in samples.items()}
    times = [
        loop_time.with_collections(
            time, sum((collections_s or {}).get(pid, 0.0) for pid in time.pids)
        )
        for time in loop_time.with_calls(sampled, calls, main_pid, stretches)
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
            running = _outermost_loop(stack)
            if running is not None and running[0] in of_loops:
                on_loops.update(places)
            else:
                rest.append((places, _outside_activity(stack), thread.interval_s))
    compiling = {call.place.position for call in calls if call.activity == Activity.COMPILING}
    seconds: dict[Place, list[tuple[Activity, float]]] = defaultdict(list)
    for places, activity, interval_s in rest:
        place = next((each for each in places if each not in on_loops), None)
        if place is not None:
            is_compiling = any(each.position in compiling for each in places)
            seconds[place].append((Activity.COMPILING if is_compiling else activity, interval_s))
    return large(LineTime.of(place, parts, wall_s) for place, parts in seconds.items())


def _outside_activity(stack: Sequence[Frame]) -> Activity:
    """Return what a stack outside loops shows; all that a module does when imported is imports."""
    if any(activities.imports(frame) for frame in stack):
        return Activity.IMPORT
    return activities.activity(stack)


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


def _outermost_loop(stack: Sequence[Frame]) -> tuple[SourceLoop, Sequence[Frame]] | None:
    """Return the outermost loop that a stack runs, and the frames from its line on.

    Those of the process that forked this one, which stand on its stack, are not meant.
    """
    own = stack[_own_begin(stack) :]
    running = program_loop([(frame.file, frame.line) for frame in own])
    if running is None:
        return None
    loop, i = running
    return replace(loop, file=activities.shown_path(loop.file)), own[i:]


def _own_begin(stack: Sequence[Frame]) -> int:
    """Return where the frames of a process begin, behind those of the one that forked it."""
    begins = [
        i + 1
        for i, frame in enumerate(stack)
        if file_owners.standard_name(frame.file) == activities.PROCESS_MODULE
        and frame.function.endswith("_bootstrap")
    ]
    return begins[-1] if begins else 0


def _stretch(samples: Sequence[_Sample], timed: Collection[tuple[str, int]]) -> float | None:
    """Return the time of a loop over the time from its first timed call to its last, by samples.

    Only the order of samples counts: how long each stands for is uncertain in a short program. It
    is 1 where those before the first call and after the last may be there by chance, and None where
    samples saw too few calls.
    """
    by_thread: dict[Thread, list[tuple[float, bool]]] = defaultdict(list)
    for sample in samples:
        is_timed = any(each.position in timed for each in sample.own_places)
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


def _lines_of_jax(calls: Sequence[CallTime], loop: SourceLoop) -> set[tuple[str, int]]:
    """Return the lines of timed calls in a loop that calls JAX: what JAX does there is timed."""
    of_loop = [call for call in calls if call.loop == loop and call.activity != Activity.PHYSICS]
    calls_jax = any(call.activity == Activity.DISPATCH for call in of_loop)
    return {call.place.position for call in of_loop if calls_jax}


def _samples(stacks: Sequence[_Stack], of_pools: Collection[int]) -> list[_Sample]:
    """Return the samples of a loop, each with its activity."""
    return [
        _Sample(thread, stack, inner, activities.activity(stack, thread.thread.pid in of_pools))
        for thread, stack, inner in stacks
    ]


def _parts(samples: Iterable[_Sample]) -> Iterator[tuple[Activity, float]]:
    return ((sample.activity, sample.seconds) for sample in samples)


def _loop_time(
    loop: SourceLoop,
    samples: Sequence[_Sample],
    main_pid: int,
    loading: Collection[tuple[str, int]],
    of_jax: Collection[tuple[str, int]],
) -> LoopTime:
    total_s = sum(sample.seconds for sample in samples)
    in_python = [sample for sample in samples if sample.activity == Activity.PYTHON]
    packages = [(file_owners.package_of(each.python.file), each.seconds) for each in in_python]
    threads = {sample.thread.thread for sample in samples}
    own_frames = {frame for sample in samples for frame in sample.inner if is_own(frame)}
    return LoopTime(
        loop=loop,
        own_files=sorted({activities.shown_path(frame.file) for frame in own_frames}),
        threads=sorted(thread.name for thread in threads),
        pids=sorted({thread.pid for thread in threads}),
        in_main=any(thread.pid == main_pid == thread.tid for thread in threads),
        samples=round(total_s**2 / sum(sample.seconds**2 for sample in samples)),
        seconds=total_s,
        activities=shares_of(_parts(samples)),
        packages=shares_of(packages, total_s),
        lines=_own_lines(samples, total_s),
        inner_functions=_inner_functions(samples, total_s, of_jax),
        building=_building_line(samples, total_s, loading),
    )


def _own_lines(samples: Sequence[_Sample], total_s: float) -> list[LineTime]:
    by_line: dict[tuple[str, int], list[_Sample]] = defaultdict(list)
    for sample in samples:
        by_line[activities.place_of(sample.own_frame).position].append(sample)
    times = []
    for of_line in by_line.values():
        frames = [sample.own_frame for sample in of_line]
        named = (frame for frame in reversed(frames) if not frame.function.startswith("<"))
        place = activities.place_of(next(named, frames[0]))
        beside = (sample for sample in of_line if sample.activity != Activity.PHYSICS)
        packages = Counter(map(_called_package, beside)).most_common(1)
        package = packages[0][0] if packages else ""
        times.append(LineTime.of(place, _parts(of_line), total_s, package))
    return large(times)


def _building_line(
    samples: Sequence[_Sample], total_s: float, loading: Collection[tuple[str, int]]
) -> LineTime | None:
    """Return the outermost line under which models are built or loaded, and nothing steps.

    What waits for other processes may let them step.

    Where there are several, it is that with most of their time, and has the time of all.
    """
    seconds: dict[Place, list[float]] = defaultdict(list)
    steps_s: dict[Place, float] = defaultdict(float)
    for sample in samples:
        is_slow_call = activities.is_slow_call(sample.stack[-1])
        for place in sample.own_places:
            seconds[place].append(sample.seconds)
            if sample.activity in (Activity.PHYSICS, *WAITING) and not is_slow_call:
                steps_s[place] += sample.seconds
    # a torn stack may show a step under another line
    without_steps = {
        place for place, parts in seconds.items() if steps_s[place] < _most_torn_s(parts)
    }
    by_outermost: dict[Place, list[tuple[Activity, float]]] = defaultdict(list)
    built_s: dict[Place, float] = defaultdict(float)
    for sample in samples:
        outermost = next((each for each in sample.own_places if each in without_steps), None)
        if outermost is None:
            continue
        loads = [each.position in loading for each in sample.own_places]
        activity = Activity.LOADING if loads[-1] else sample.activity
        by_outermost[outermost].append((activity, sample.seconds))
        if sample.activity == Activity.BUILDING or any(loads):
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


def _shown_places(stack: Sequence[Frame]) -> list[Place]:
    own = [frame for frame in stack if is_own(frame)]
    return list(dict.fromkeys(map(activities.place_of, own)))


def _called_package(sample: _Sample) -> str:
    own = sample.own_frame
    called = list(itertools.takewhile(lambda frame: frame != own, reversed(sample.inner)))
    packages = (file_owners.package_of(each.file) for each in called[::-1])
    return next(filter(None, packages), "")


def _inner_functions(
    samples: Sequence[_Sample], total_s: float, of_jax: Collection[tuple[str, int]]
) -> list[LineTime]:
    functions: dict[tuple[str, str], list[_Sample]] = defaultdict(list)
    for sample in samples:
        own_line = activities.place_of(sample.own_frame).position
        if sample.activity == Activity.POLICY and own_line in of_jax:
            continue
        frame = sample.python
        if sample.activity != Activity.PHYSICS and file_owners.package_of(frame.file):
            functions[frame.file, frame.function].append(sample)
    times = []
    for (file, function), of_function in functions.items():
        ((line, _),) = Counter(sample.python.line for sample in of_function).most_common(1)
        place = Place(activities.shown_path(file), line, function, f"{function}()")
        times.append(LineTime.of(place, _parts(of_function), total_s))
    return large(times)
