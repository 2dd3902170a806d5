"""Loops that keep a rate: iterations that were late count, and what made them late."""

from collections.abc import Sequence

from mjbench.commands.run.activities import Activity
from mjbench.commands.run.call_times import CallTime
from mjbench.commands.run.loop_time import LineStay, LoopTime
from mjbench.commands.run.step_times import Durations, StepTimes
from mjbench.formats import duration, plain, whole_percent

# Simulated seconds per second between which a loop that sleeps keeps real time.
_SLOWEST, _FASTEST = 0.9, 1.1
# Slower loops are meant to be slow.
_SLOW_MOTION = 0.6
# A loop that sleeps less than this keeps no rate.
_LEAST_SLEEP = 0.1
# A cause takes at least this share of the longest delay.
_LEAST_CAUSE = 0.5


def pace(time: LoopTime, steps: Sequence[StepTimes], queued_s: float | None) -> str:
    """Return how a loop keeps real time, and what made its longest iteration late.

    It is empty where the loop keeps no rate.

    Args:
      queued_s: for which the main thread could run, and had no core; None where it is not known.
    """
    of_loop = [each for each in steps if each.pid in time.pids]
    of_process = max(of_loop, key=lambda each: each.nstep, default=None)
    sleep = time.activities.get(Activity.SLEEPING, 0.0)
    if of_process is None or of_process.iteration is None or sleep < _LEAST_SLEEP:
        return ""
    factor, iteration = of_process.real_time_factor, of_process.iteration
    if factor is None or not _SLOW_MOTION <= factor <= _FASTEST:
        return ""
    if factor < _SLOWEST:
        slow = (
            f"runs at {plain(factor, 2)} × real time: it sleeps for all of the simulated time, and"
            " works beside; sleep until the start plus data.time instead"
        )
        return slow if sleep >= factor else ""
    rate = f"keeps real time ({plain(factor, 2)} ×; it sleeps {whole_percent(sleep)} of the time)"
    longest_ns = max(iteration.max_ns, 1e9 * of_process.longest_collection_s)
    if not iteration.late and longest_ns <= iteration.late_ns:
        return f"{rate}, and none of {iteration.count:,} timed iterations was late"
    cause = (
        _by_collection(of_process, iteration, longest_ns)
        or _by_line(time.longest_stay, iteration, longest_ns)
        or _by_call(time.calls, iteration)
        or _by_others(queued_s, iteration, longest_ns)
    )
    return (
        f"{rate}, but {iteration.late:,} of {iteration.count:,} timed iterations were late (over"
        f" {duration(iteration.late_ns)}), the longest {duration(longest_ns)}: {cause}"
    )


def _by_collection(steps: StepTimes, iteration: Durations, longest_ns: float) -> str:
    collection_ns = 1e9 * steps.longest_collection_s
    if collection_ns < _LEAST_CAUSE * (longest_ns - iteration.p50_ns):
        return ""
    return (
        f"a garbage collection took {duration(collection_ns)}; call gc.collect() and gc.freeze()"
        " after set-up, before the loop"
    )


def _by_line(stay: LineStay | None, iteration: Durations, longest_ns: float) -> str:
    if stay is None or 1e9 * stay.seconds < _LEAST_CAUSE * (longest_ns - iteration.p50_ns):
        return ""
    return (
        f"{stay.place} took about {duration(1e9 * stay.seconds)} at once ({stay.place.text}); do"
        " this after the loop, or in a process of its own"
    )


def _by_call(calls: Sequence[CallTime], iteration: Durations) -> str:
    longest = max(calls, key=lambda call: call.seconds / max(1.0, call.calls), default=None)
    if longest is None:
        return ""
    mean_ns = 1e9 * longest.seconds / max(1.0, longest.calls)
    if mean_ns < _LEAST_CAUSE * iteration.p50_ns:
        return ""
    return f"{longest.callee} at {longest.place} takes {duration(mean_ns)} each time"


def _by_others(queued_s: float | None, iteration: Durations, longest_ns: float) -> str:
    if queued_s is not None and 1e9 * queued_s >= _LEAST_CAUSE * (longest_ns - iteration.p50_ns):
        return (
            f"its thread waited {plain(queued_s, 2)} s for a core, which other programs had; run it"
            " alone, or on a core of its own (taskset)"
        )
    return "what they have in common was not seen"
