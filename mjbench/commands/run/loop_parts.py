"""What the time of one loop is divided into: calls that were timed, and samples for the rest.

Each part is a piece of the loop's time with the line that takes it and what is done there. Parts
are allocated once; shares of activities, packages and lines are sums of them.
"""

import itertools
import re
from collections import Counter, defaultdict
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from mjbench.commands.run import activities
from mjbench.commands.run.activities import Activity, Place, is_own
from mjbench.commands.run.call_times import CREATORS, CallTime
from mjbench.commands.run.hook import call_clock, file_owners
from mjbench.commands.run.loop_time import FEW_SAMPLES, LineStay, error_of, shares_of
from mjbench.commands.run.py_spy import Frame, Thread, ThreadSamples

# Where samples saw a loop for this many times as long as its calls span, they say how long it runs.
_LEAST_BEYOND = 1.1
# Times the error of samples from which on the error of bursts is large: samples may miss calls.
FAR_BETTER = 3
# What samples show of a line that calls what is timed: its own text may tell it.
_KNOWN_BY_LINE = {Activity.PHYSICS, Activity.PYTHON, Activity.BINDINGS, Activity.NUMPY}
# Where samples saw less than this beside the calls that are timed, they do not divide the rest.
_LEAST_REST = 0.02
# Smaller shares are differences of rounded numbers.
_LEAST_PART = 1e-6
# A line that is one call.
ONE_CALL = re.compile(r"([\w\s,]+ = )?[\w.]+\([\w\s.,=]*\)(\s*#.*)?$")
# Average gaps between timed calls that may lie beyond the first and the last by chance: more do in
# 4 % of the cases, if the gaps are exponentially distributed. Times that samples must see calls.
_MOST_CHANCE_GAPS, _LEAST_RUNS = 5, 10
# Runs of samples on one line that are expected less often than this are one stay.
_RARE = 0.05


@dataclass(frozen=True)
class Sample:
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
        return shown_places(self.inner)

    @cached_property
    def own_frame(self) -> Frame:
        """The innermost line of the user's code; that of the loop where none is."""
        own = (frame for frame in reversed(self.inner) if is_own(frame))
        return next(own, self.inner[0])

    @cached_property
    def called(self) -> Sequence[Frame]:
        """What that line calls, outermost first."""
        beyond = itertools.takewhile(lambda each: each != self.own_frame, reversed(self.inner))
        return list(beyond)[::-1]


@dataclass(frozen=True)
class Part:
    """A part of a loop's time.

    Attributes:
      place: the line of the user's code; None for what no line shows.
      sample: that shows it; None for what was timed, and for what is left without samples.
    """

    activity: Activity
    seconds: float
    place: Place | None
    sample: Sample | None = None

    @property
    def package(self) -> str:
        """The installed package whose Python runs; "" for the user's own code."""
        return file_owners.package_of(self.sample.python.file) if self.sample else ""


def untorn(samples: Sequence[Sample], calls: Sequence[CallTime]) -> list[Sample]:
    """Return samples in which no line that is one step calls something else, and no other steps.

    The program runs while its stack is read, from the innermost function on. What such a line seems
    to call is what the line before it called. Where the engine has returned meanwhile, the line is
    one that the program has come to.
    """
    timed = {call.place.position for call in calls}
    samples = [_returned(sample, timed) for sample in samples] if timed else samples
    steps = {
        call.place.position
        for call in calls
        if call.callee in call_clock.STEPS and ONE_CALL.match(call.place.text)
    }
    callers = defaultdict[tuple[str, str], Counter[Frame]](Counter)
    are_torn = []
    for sample in samples:
        calls_other = bool(sample.called) and not activities.is_step_clock(sample.called[0])
        is_step = activities.place_of(sample.own_frame).position in steps
        are_torn.append(calls_other and is_step)
        if calls_other and not is_step:
            callers[sample.called[0].file, sample.called[0].function][sample.own_frame] += 1

    def whole(sample: Sample) -> Sample:
        own, called = sample.own_frame, sample.called[0]
        of_called = callers[called.file, called.function]
        caller = max(of_called, key=lambda each: of_called[each], default=own)
        return replace(sample, inner=[caller if each == own else each for each in sample.inner])

    return [
        whole(sample) if is_torn else sample
        for sample, is_torn in zip(samples, are_torn, strict=True)
    ]


def _returned(sample: Sample, timed: Collection[tuple[str, int]]) -> Sample:
    place, called = activities.place_of(sample.own_frame), len(sample.called)
    if place.position in timed or not called or not activities.is_step_clock(sample.stack[-1]):
        return sample
    stack, inner = sample.stack[:-called], sample.inner[:-called]
    return replace(sample, stack=stack, inner=inner, activity=activities.activity(stack))


def shown_places(stack: Sequence[Frame]) -> list[Place]:
    """Return the lines of the user's code on a stack, outermost first."""
    own = [frame for frame in stack if is_own(frame)]
    return list(dict.fromkeys(map(activities.place_of, own)))


def equal_samples(samples: Sequence[Sample]) -> int:
    """Return how many samples of equal time tell as much (Kish's effective sample size)."""
    squares = sum(sample.seconds**2 for sample in samples)
    return round(_seconds_of(samples) ** 2 / squares) if samples else 0


def longest_stay(samples: Sequence[Sample]) -> LineStay | None:
    """Return the longest run of samples of a thread on one line that does not sleep.

    Runs that samples of a line show by chance, at its share of them, are none.
    """
    places = [activities.place_of(sample.own_frame) for sample in samples]
    counts, stays = Counter(places), []
    of_line = zip(samples, places, strict=True)
    for (_, place), run in itertools.groupby(of_line, key=lambda s: (s[0].thread.thread, s[1])):
        seen = [sample for sample, _ in run]
        chance = counts[place] * (counts[place] / len(samples)) ** (len(seen) - 1)
        if chance < _RARE and all(sample.activity != Activity.SLEEPING for sample in seen):
            stays.append(LineStay(place, _seconds_of(seen)))
    return max(stays, key=lambda stay: stay.seconds, default=None)


def _seconds_of(parts: Iterable[Sample | Part | CallTime]) -> float:
    return sum(part.seconds for part in parts)


def loop_seconds(samples: Sequence[Sample], calls: Sequence[CallTime]) -> float:
    """Return how long a loop runs, summed over threads: by its calls, and by samples beyond."""
    sampled_s = _seconds_of(samples)
    if not calls:
        return sampled_s
    seconds = _span_s(calls)
    first = samples[0] if samples else None
    if first and not is_own(first.inner[0]) and any(map(activities.calls_tasks, first.stack)):
        # between two tasks of a pool, its worker takes the next one, or waits
        return max(sampled_s, _seconds_of(calls))
    if equal_samples(samples) < FEW_SAMPLES:
        return seconds
    seconds *= _stretch(samples, {call.place.position for call in calls}) or 1.0
    # it also runs without these calls, or those after the last burst took longer than those in it
    least_s = sum(min(sample.seconds, sample.thread.least_s) for sample in samples)
    return sampled_s if least_s > _LEAST_BEYOND * seconds else seconds


def by_samples(
    samples: Sequence[Sample], calls: Sequence[CallTime], seconds: float, step_error: float
) -> Sequence[CallTime]:
    """Return calls, where samples tell far better than bursts for how long a loop steps.

    Args:
      step_error: standard error of the time of steps in bursts, as a share of it.
    """
    steps = [call for call in calls if call.callee in call_clock.STEPS]
    lines, steps_s = {call.place.position for call in steps}, _seconds_of(steps)
    # such a line may also call other functions, as that of an environment's step does
    stepping = [s for s in samples if s.activity == Activity.PHYSICS or not s.called]
    on_lines = [s for s in stepping if activities.place_of(s.own_frame).position in lines]
    sampled_s, count = _seconds_of(samples), equal_samples(samples)
    share = _seconds_of(on_lines) / sampled_s if sampled_s else 0.0
    least = FAR_BETTER * error_of(share, count) * seconds
    if count < FEW_SAMPLES or not share or steps_s * step_error <= least:
        return calls
    factor = share * seconds / steps_s
    return [replace(c, seconds=factor * c.seconds) if c in steps else c for c in calls]


def parts_of(
    samples: Sequence[Sample], calls: Sequence[CallTime], seconds: float, collections_s: float
) -> list[Part]:
    """Divide the time of a loop: what calls took is known, and samples divide the rest.

    Garbage collections may begin on any line that creates an object; calls that are timed hold few
    of them.

    Args:
      seconds: that the loop takes.
      collections_s: seconds of garbage collections, which samples of Python alone do not show.
    """
    parts = list(_of_calls(samples, calls, seconds))
    left_s = max(0.0, seconds - _seconds_of(calls))
    if (collected_s := min(left_s, collections_s)) > 0:
        parts.append(Part(Activity.COLLECTION, collected_s, None))
        left_s -= collected_s
    sampled = _beside(samples, calls, seconds)
    sampled_s, total_s = _seconds_of(sampled), _seconds_of(samples)
    has_samples = equal_samples(samples) >= FEW_SAMPLES
    if not calls or (has_samples and sampled_s > _LEAST_REST * total_s):
        factor = left_s / sampled_s
        sampled = [replace(part, seconds=factor * part.seconds) for part in sampled]
    else:
        # samples that are all on the lines of these calls saw the calls themselves
        sampled = [Part(Activity.BINDINGS if has_samples else Activity.REST, left_s, None)]
    return [*parts, *(sampled if left_s > _LEAST_PART * seconds else ())]


def _of_calls(
    samples: Sequence[Sample], calls: Sequence[CallTime], seconds: float
) -> Iterator[Part]:
    """Yield what calls took; what compiled functions compare, as samples show, is apart."""
    compared_s = defaultdict[tuple[str, int], float](float)
    factor = seconds / max(1e-9, _seconds_of(samples))
    for sample in samples:
        if sample.activity == Activity.COMPARING:
            position = activities.place_of(sample.own_frame).position
            compared_s[position] += factor * sample.seconds
    for call in calls:
        of_call_s = 0.0
        if call.activity == Activity.DISPATCH:
            of_call_s = min(call.seconds, compared_s.pop(call.place.position, 0.0))
        yield Part(call.activity, call.seconds - of_call_s, call.place)
        if of_call_s:
            yield Part(Activity.COMPARING, of_call_s, call.place)


def _beside(samples: Sequence[Sample], calls: Sequence[CallTime], seconds: float) -> Sequence[Part]:
    """Return the samples of what is not timed.

    On the line of a timed call that is no step, samples may see the call itself as Python or NumPy:
    what they see beyond its time makes the call, or frees its result. Where a function returns, its
    objects are freed on the line that called it.
    """
    timed = {call.activity for call in calls}
    if Activity.DISPATCH in timed:
        timed.add(Activity.COMPARING)
    slow = shares_of(
        (
            (call.place.position, call.seconds)
            for call in calls
            if call.activity != Activity.PHYSICS
        ),
        seconds,
    )
    # JAX itself, where it is called
    of_jax = {Activity.POLICY} if Activity.DISPATCH in timed else set()
    known = {*_KNOWN_BY_LINE, *timed, *of_jax}
    creating = sorted((c for c in calls if c.callee in CREATORS), key=lambda call: call.seconds)
    freeing = {line: call for call in creating for line in call.lines[1:]}
    parts: list[Part] = []
    of_calls = defaultdict[tuple[str, int], list[Part]](list)
    for sample in samples:
        place = activities.place_of(sample.own_frame)
        part = Part(sample.activity, sample.seconds, place, sample)
        if place.position in slow and sample.activity in known:
            of_calls[place.position].append(part)
        elif place.position in freeing and _is_of_line_alone(sample):
            created = freeing[place.position]
            parts.append(replace(part, activity=created.activity, place=created.place))
        elif sample.activity not in timed:
            parts.append(part)
    for position, of_call in of_calls.items():
        share = _seconds_of(of_call) / _seconds_of(samples)
        more = share - slow[position]
        if more > 2 * error_of(share, equal_samples(samples)):
            parts += [
                replace(part, activity=Activity.BINDINGS, seconds=part.seconds * more / share)
                for part in of_call
            ]
    return parts


def _is_of_line_alone(sample: Sample) -> bool:
    return not sample.called and sample.activity in (Activity.PYTHON, Activity.BINDINGS)


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
    return max(1e-9, loop_s, _seconds_of(calls))


def _stretch(samples: Sequence[Sample], timed: Collection[tuple[str, int]]) -> float | None:
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
