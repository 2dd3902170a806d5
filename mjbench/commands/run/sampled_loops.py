"""Where the time of a program's stepping loops goes, from samples of its stacks."""

from collections import Counter, defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

from mjbench.commands.run import activities
from mjbench.commands.run.activities import WAITING, Activity, Place, is_own
from mjbench.commands.run.call_times import CallTime
from mjbench.commands.run.hook import file_owners
from mjbench.commands.run.hook.call_clock import COMPILE, DISPATCH, PROCESS_START
from mjbench.commands.run.loop_parts import (
    Part,
    Sample,
    by_samples,
    equal_samples,
    longest_stay,
    loop_seconds,
    parts_of,
    shown_places,
    untorn,
)
from mjbench.commands.run.loop_time import (
    FEW_SAMPLES,
    LEAST_REPEATS,
    LineTime,
    LoopTime,
    large,
    shares_of,
)
from mjbench.commands.run.py_spy import Frame, ThreadSamples
from mjbench.commands.run.source_loops import SourceLoop, function_around, program_loop

# Loops with a smaller share of the time of all loops that step, on a thread, are left out.
LEAST_LOOP_SHARE = 0.05
# Share of a line's samples that may show a step that it does not make; of a few, one sample may.
_MOST_TORN_SHARE, _FEW_TORN_SHARE = 0.05, 0.25
# Calls that show a loop, of which there may be no samples, beside those that step.
_SHOWN = (COMPILE, DISPATCH, PROCESS_START)
# A function of a process: its file and its name.
_Function = tuple[int, str, str]


def with_sampled_loops(
    threads: Sequence[ThreadSamples], calls: Sequence[CallTime]
) -> list[CallTime]:
    """Return calls with the loops in which samples mostly see the functions that make them.

    The clock notes the stack of a line's first call alone, which may come before the loop; the loop
    begins with a call that was first made in it. What a function that a pool calls does again and
    again is of that function, as of a loop.
    """
    begins: dict[tuple[int, SourceLoop | None], int] = {}
    for call in sorted(calls, key=lambda call: call.first_ns):
        begins.setdefault((call.pid, call.loop), call.first_ns)
    often = (call for call in calls if call.calls >= LEAST_REPEATS)
    tasks = {_function_of(call.place) for call in often if call.loop is None}
    counts: dict[_Function, Counter[SourceLoop | None]] = defaultdict(Counter)
    outer: dict[tuple[_Function, SourceLoop], Sequence[Place]] = {}
    for thread in threads:
        for stack in thread.stacks:
            running = _outermost_loop(stack, tasks)
            loop, inner = running if running is not None else (None, stack)
            above = shown_places(inner[:1])
            holders = {(each.file, each.function) for each in above}
            for place in shown_places(inner[1:] if loop else inner):
                function = thread.thread.pid, place.file, place.function
                counts[function][None if function[1:] in holders else loop] += 1
                if loop is not None:
                    outer.setdefault((function, loop), above.copy())
                above.append(place)

    def in_loop(call: CallTime) -> CallTime:
        function = call.pid, call.place.file, call.place.function
        loop, count = max(counts[function].items(), key=lambda each: each[1], default=(None, 0))
        if loop is None or loop == call.loop or min(count, call.calls) < LEAST_REPEATS:
            return call
        lines = [call.place, *reversed(outer[function, loop])]
        first_ns = max(call.first_ns, begins.get((call.pid, loop), call.first_ns))
        positions = [place.position for place in lines]
        return replace(call, loop=loop, lines=positions, first_ns=first_ns)

    return list(map(in_loop, calls))


def loop_times(
    threads: Sequence[ThreadSamples],
    main_pid: int,
    stepping_pids: Collection[int] = (),
    calls: Sequence[CallTime] = (),
    collections_s: Mapping[int, float] | None = None,
    step_errors: Mapping[int, float] | None = None,
) -> list[LoopTime]:
    """Return the loops that step, or wait for processes that do; the program's own first.

    Args:
      stepping_pids: processes that are known to step; samples may miss a small share of physics.
      calls: that were timed one by one; they also show loops of which there are no samples.
      collections_s: seconds of garbage collections by process, which samples of Python alone do
        not show.
      step_errors: standard errors of the time of steps by process, as a share of it.
    """
    of_pools = {
        each.thread.pid for each in threads if any(map(activities.is_of_thread_pool, each.stacks))
    }
    by_loop: dict[SourceLoop, list[Sample]] = defaultdict(list)
    of_calls = {call.loop for call in calls}
    for thread in threads:
        for stack in thread.stacks:
            if (running := _outermost_loop(stack, of_calls)) is not None:
                loop, inner = running
                activity = activities.activity(stack, thread.thread.pid in of_pools)
                by_loop[loop].append(Sample(thread, stack, inner, activity))
    calls_by_loop: dict[SourceLoop, list[CallTime]] = defaultdict(list)
    for call in calls:
        if call.loop is not None:
            calls_by_loop[call.loop].append(call)
    stepping_s = defaultdict[int, dict[SourceLoop, float]](dict)  # by process
    for loop, samples in by_loop.items():
        steps = any(sample.activity == Activity.PHYSICS for sample in samples)
        if steps or any(call.is_step for call in calls_by_loop[loop]):
            for sample in samples:
                of_process = stepping_s[sample.thread.thread.pid]
                of_process[loop] = of_process.get(loop, 0.0) + sample.seconds
    times = []
    for loop in dict.fromkeys([*by_loop, *calls_by_loop]):
        samples, timed = by_loop[loop], calls_by_loop[loop]
        # which of several loops a collection interrupts is not known
        collected_s = {
            pid: seconds
            for pid, seconds in (collections_s or {}).items()
            if stepping_s[pid].get(loop, 0.0)
            >= (1 - LEAST_LOOP_SHARE) * sum(stepping_s[pid].values())
        }
        if samples or any(call.is_step or call.callee in _SHOWN for call in timed):
            errors = step_errors or {}
            time = _loop_time(loop, samples, timed, main_pid, collected_s, errors)
            times.append(replace(time, unpickling_share=_unpickling_share(time, threads)))
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
    # samples of a short loop may miss it
    on_loops = {line for time in loops for call in time.calls for line in call.lines}
    rest: list[tuple[list[Place], Activity, float]] = []
    for thread in threads:
        if not thread.thread.pid == main_pid == thread.thread.tid:
            continue
        for stack in thread.stacks:
            places = shown_places(stack)
            if not loops:  # what the module calls is the program itself
                on_loops.update(each.position for each in places[:-1][:1])
            running = _outermost_loop(stack)
            if running is not None and running[0] in of_loops:
                on_loops.update(each.position for each in places)
            else:
                rest.append((places, _outside_activity(stack), thread.interval_s))
    compiling = {call.place.position for call in calls if call.activity == Activity.COMPILING}
    seconds: dict[Place, list[tuple[Activity, float]]] = defaultdict(list)
    for places, activity, interval_s in rest:
        place = next((each for each in places if each.position not in on_loops), None)
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
    # workers that wait do not hide the loop that they wait for, however many there are
    least_s = LEAST_LOOP_SHARE * sum(time.seconds_of_thread for time in stepping + waiting)
    return [time for time in stepping + waiting if time.seconds_of_thread >= least_s]


def _waits_for_ends(time: LoopTime) -> bool:
    """Return whether a loop waits for processes or threads to end, whose own loops then count."""

    def waiting(line: LineTime) -> float:
        return sum(line.activities.get(each, 0.0) for each in WAITING)

    longest = max(time.lines, key=waiting, default=None)
    return longest is not None and waiting(longest) > 0 and ".join(" in longest.place.text


def _outermost_loop(
    stack: Sequence[Frame], tasks: Collection[SourceLoop | None] = ()
) -> tuple[SourceLoop, Sequence[Frame]] | None:
    """Return the outermost loop that a stack runs, and the frames from its line on.

    Those of the process that forked this one, which stand on its stack, are not meant.

    Args:
      tasks: functions that count as loops where a pool calls them.
    """
    own = stack[_own_begin(stack) :]
    callers = [i for i, frame in enumerate(own) if activities.calls_tasks(frame)]
    first = next((i for i in range(callers[-1], len(own)) if is_own(own[i])), 0) if callers else 0
    if first:
        task = _function_of(activities.place_of(own[first]))
        if task is not None and task in tasks:
            return task, own[first - 1 :]
    running = program_loop([(frame.file, frame.line) for frame in own])
    if running is None:
        return None
    loop, i = running
    return replace(loop, file=activities.shown_path(loop.file)), own[i:]


def _function_of(place: Place) -> SourceLoop | None:
    return function_around(place.file, place.line)


def _own_begin(stack: Sequence[Frame]) -> int:
    """Return where the frames of a process begin, behind those of the one that forked it."""
    begins = [
        i + 1
        for i, frame in enumerate(stack)
        if file_owners.standard_name(frame.file) == activities.PROCESS_MODULE
        and frame.function.endswith("_bootstrap")
    ]
    return begins[-1] if begins else 0


def _loading_lines(calls: Sequence[CallTime]) -> set[tuple[str, int]]:
    counts: dict[tuple[str, int], float] = defaultdict(float)
    for call in calls:
        if call.activity == Activity.LOADING:
            counts[call.place.position] += call.calls
    return {line for line, count in counts.items() if count >= LEAST_REPEATS}


def _loop_time(
    loop: SourceLoop,
    samples: Sequence[Sample],
    calls: Sequence[CallTime],
    main_pid: int,
    collections_s: Mapping[int, float],
    step_errors: Mapping[int, float],
) -> LoopTime:
    samples = untorn(samples, calls)
    threads = {sample.thread.thread for sample in samples}
    pids = sorted({each.pid for each in threads or calls})
    is_main = any(each.pid == main_pid == each.tid for each in threads)
    own_frames = {frame for sample in samples for frame in sample.inner if is_own(frame)}
    own_files = {activities.shown_path(frame.file) for frame in own_frames}
    seconds = loop_seconds(samples, calls)
    step_error = max((step_errors.get(pid, 0.0) for pid in pids), default=0.0)
    calls = by_samples(samples, calls, seconds, step_error)
    collected_s = sum(collections_s.get(pid, 0.0) for pid in pids)
    parts = parts_of(samples, calls, seconds, collected_s)
    return LoopTime(
        loop=loop,
        own_files=sorted(own_files | {call.place.file for call in calls}),
        threads=sorted(thread.name for thread in threads) or ["MainThread"],
        pids=pids,
        in_main=is_main if samples else main_pid in pids,
        samples=equal_samples(samples),
        seconds=seconds,
        activities=shares_of(_times(parts), seconds),
        lines=_own_lines(parts, seconds),
        lines_on_stack=_lines_on_stack(samples),
        inner_functions=_inner_functions(parts, seconds),
        calls=calls,
        building=_building_line(samples, parts, calls, seconds),
        longest_stay=longest_stay(samples),
    )


def _times(parts: Iterable[Part]) -> Iterator[tuple[Activity, float]]:
    return ((part.activity, part.seconds) for part in parts)


def _unpickling_share(time: LoopTime, threads: Sequence[ThreadSamples]) -> float:
    """Return the part of a loop's time for which the process that unpickles most does that."""
    others = (each for each in threads if each.thread.pid not in time.pids)
    seconds = [sum(map(activities.unpickles, each.stacks)) * each.interval_s for each in others]
    return min(1.0, max(seconds, default=0.0) / time.seconds_of_thread)


def _own_lines(parts: Sequence[Part], total_s: float) -> list[LineTime]:
    by_line: dict[tuple[str, int], list[tuple[Place, Part]]] = defaultdict(list)
    for part in parts:
        if part.place is not None:
            by_line[part.place.position].append((part.place, part))
    times = []
    for of_line in by_line.values():
        places = [place for place, _ in reversed(of_line)]
        named = (place for place in places if not place.function.endswith(">"))
        beside = (part.sample for _, part in of_line if part.activity != Activity.PHYSICS)
        packages = Counter(map(_called_package, filter(None, beside))).most_common(1)
        package = packages[0][0] if packages else ""
        of_parts = _times(part for _, part in of_line)
        times.append(LineTime.of(next(named, places[-1]), of_parts, total_s, package))
    return large(times)


def _lines_on_stack(samples: Sequence[Sample]) -> list[LineTime]:
    by_line: dict[tuple[str, int], list[tuple[Place, Sample]]] = defaultdict(list)
    for sample in samples:
        for position, place in {each.position: each for each in sample.own_places}.items():
            by_line[position].append((place, sample))
    total_s = sum(sample.seconds for sample in samples)
    return large(
        LineTime.of(of_line[0][0], ((s.activity, s.seconds) for _, s in of_line), total_s)
        for of_line in by_line.values()
    )


def _building_line(
    samples: Sequence[Sample], parts: Sequence[Part], calls: Sequence[CallTime], total_s: float
) -> LineTime | None:
    """Return the outermost line under which models are built or loaded, and nothing steps.

    What waits for other processes may let them step.

    Where there are several, it is that with most of their time, and has the time of all, with the
    timed calls that load models.
    """
    loading, seconds = _loading_lines(calls), defaultdict[Place, list[float]](list)
    steps_s = defaultdict[Place, float](float)
    for sample in samples:
        is_slow_call = activities.is_slow_call(sample.stack[-1])
        for place in sample.own_places:
            seconds[place].append(sample.seconds)
            if sample.activity in (Activity.PHYSICS, *WAITING) and not is_slow_call:
                steps_s[place] += sample.seconds

    def outermost(sample: Sample) -> Place | None:
        # a torn stack may show a step under another line
        places = (each for each in sample.own_places if steps_s[each] < _most_torn_s(seconds[each]))
        return next(places, None)

    whole_s, built_s = defaultdict[Place, float](float), defaultdict[Place, float](float)
    for sample in samples:
        if (line := outermost(sample)) is not None:
            whole_s[line] += sample.seconds
            is_loading = any(each.position in loading for each in sample.own_places)
            if sample.activity == Activity.BUILDING or is_loading:
                built_s[line] += sample.seconds
    if not built_s:
        return None
    most = max(built_s, key=lambda each: built_s[each])
    lines = {each for each, of_line_s in built_s.items() if 2 * of_line_s >= whole_s[each]} | {most}
    built = [part for part in parts if part.sample and outermost(part.sample) in lines]
    loaded = [part for part in parts if part.activity == Activity.LOADING]
    return LineTime.of(most, _times([*built, *loaded]), total_s)


def _most_torn_s(seconds: Sequence[float]) -> float:
    """Return the time of a line's samples that may show a step that it does not make."""
    one_s = min(1.5 * max(seconds), _FEW_TORN_SHARE * sum(seconds))
    return max(one_s, _MOST_TORN_SHARE * sum(seconds))


def _called_package(sample: Sample) -> str:
    packages = (file_owners.package_of(each.file) for each in sample.called)
    return next(filter(None, packages), "")


def _inner_functions(parts: Sequence[Part], total_s: float) -> list[LineTime]:
    functions: dict[tuple[str, str], list[tuple[int, Part]]] = defaultdict(list)
    for part in parts:
        if part.sample is not None and part.package and part.sample.activity != Activity.PHYSICS:
            frame = part.sample.python
            functions[frame.file, frame.function].append((frame.line, part))
    times = []
    for (file, function), of_function in functions.items():
        ((line, _),) = Counter(line for line, _ in of_function).most_common(1)
        place = Place(activities.shown_path(file), line, function, f"{function}()")
        times.append(LineTime.of(place, _times(part for _, part in of_function), total_s))
    return large(times)
