"""How long threads of Python wait for the interpreter's lock (GIL), and which thread holds it.

The kernel says for how long a thread was blocked. Samples say what share of that it slept, waited
for a lock, or for a file. The rest is the GIL's, but no more than others held it.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

from mjbench.bounds import Share
from mjbench.program import activities
from mjbench.program.activities import Activity, Place, is_own
from mjbench.program.samples import Frame, ThreadSamples
from mjbench.program.thread_times import ThreadTime

# A smaller share of a thread's time is not worth a line; fewer samples of the holders tell little.
LEAST_SHARE, LEAST_HOLDER_SAMPLES = 0.05, 20
# What a thread does that waits for nothing but the GIL.
_RUNNING = {
    Activity.PHYSICS,
    Activity.PYTHON,
    Activity.BINDINGS,
    Activity.NUMPY,
    Activity.ALLOCATION,
    Activity.BUILDING,
    Activity.COLLECTION,
}


@dataclass(frozen=True)
class Holders:
    """Samples of the threads that hold the GIL of one process."""

    pid: int
    threads: Sequence[ThreadSamples]
    samples: int


@dataclass(frozen=True)
class GilWait:
    """A thread that waits for the GIL.

    Attributes:
      thread: its name.
      pid: its process.
      share: of its time for which it waits, at least: it may also wait while it has no core.
      holder: name of the thread that holds the GIL longest of the others.
      holder_share: of the time for which that one holds it.
      place: the line of the user's code at which it does most often.
    """

    thread: str
    pid: int
    share: Share
    holder: str
    holder_share: Share
    place: Place


def gil_waits(
    times: Sequence[ThreadTime], threads: Sequence[ThreadSamples], holders: Holders | None
) -> list[GilWait]:
    """Return the threads that wait for the GIL, those that wait longest first.

    Args:
      holders: None where no process has several busy threads.
    """
    if holders is None or not holders.samples:
        return []
    holders_by_tid = {each.thread.tid: each for each in holders.threads if each.stacks}
    if sum(len(each.stacks) for each in holders_by_tid.values()) < LEAST_HOLDER_SAMPLES:
        return []
    by_tid = {(each.pid, each.tid): each for each in times if each.is_busy}
    waits = []
    for thread in _merged(threads):
        time = by_tid.get((thread.thread.pid, thread.thread.tid))
        others = [each for tid, each in holders_by_tid.items() if tid != thread.thread.tid]
        if time is None or time.pid != holders.pid or not others:
            continue
        most = max(others, key=lambda each: len(each.stacks))
        by_others = sum(len(each.stacks) for each in others) / holders.samples
        share = min(time.blocked_share - _waiting_share(thread), by_others)
        if share >= LEAST_SHARE:
            place = _place(most.stacks)
            if place is not None:
                holder_share = min(1.0, len(most.stacks) / holders.samples)
                name = most.thread.name
                waits.append(
                    GilWait(thread.thread.name, time.pid, share, name, holder_share, place)
                )
    return sorted(waits, key=lambda wait: -wait.share)


def _merged(threads: Sequence[ThreadSamples]) -> list[ThreadSamples]:
    """Return the samples of each thread, also where the profiler's rate was changed meanwhile."""
    merged: dict[tuple[int, int], ThreadSamples] = {}
    for each in threads:
        key = each.thread.pid, each.thread.tid
        stacks = [*merged[key].stacks, *each.stacks] if key in merged else each.stacks
        merged[key] = replace(each, stacks=stacks)
    return list(merged.values())


def _waiting_share(thread: ThreadSamples) -> float:
    """Return the share of samples in which a thread waits for something but the GIL."""
    if not thread.stacks:
        return 0.0
    waiting = sum(
        activities.steps_on_threads(stack)
        or activities.activity(stack, thread.has_native) not in {*_RUNNING, None}
        for stack in thread.stacks
    )
    return waiting / len(thread.stacks)


def _place(stacks: Sequence[Sequence[Frame]]) -> Place | None:
    """Return the user's line that most stacks are at; None where none has one."""
    own = (next((frame for frame in reversed(stack) if is_own(frame)), None) for stack in stacks)
    lines = Counter(each for each in own if each is not None)
    return next((activities.place_of(frame) for frame, _ in lines.most_common(1)), None)
