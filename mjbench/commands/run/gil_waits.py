"""How long threads of Python wait for the interpreter's lock (GIL), and which thread holds it.

Linux accounts for how long a thread ran, waited for a core, and was blocked. Samples say what share
of that it slept, waited for a lock, or for a file. The rest is the GIL's, but no more than others
held it.
"""

import contextlib
import time
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from mjbench.bounds import NonNegativeInt, Share
from mjbench.commands.run import activities
from mjbench.commands.run.activities import Activity, Place, is_own
from mjbench.commands.run.py_spy import Frame, ThreadSamples

# A smaller share of a thread's time is not worth a line; fewer samples of the holders tell little.
LEAST_SHARE, LEAST_HOLDER_SAMPLES = 0.05, 20
# What a thread does that waits for nothing but the GIL.
_RUNNING = {
    Activity.PHYSICS,
    Activity.PYTHON,
    Activity.BINDINGS,
    Activity.NUMPY,
    Activity.BUILDING,
    Activity.COLLECTION,
}
# A thread that runs for less of its time has nothing to wait for.
BUSY_SHARE = 0.05
# Shorter times tell little.
LEAST_S = 0.5


@dataclass(frozen=True)
class ThreadTime:
    """What one thread did between two looks; `queued_s` is for which it waited for a core."""

    pid: int
    tid: int
    wall_s: float
    processor_s: float
    queued_s: float

    @property
    def is_busy(self) -> bool:
        return self.wall_s >= LEAST_S and self.processor_s >= BUSY_SHARE * self.wall_s

    @property
    def blocked_share(self) -> float:
        """The share of its time for which it could not have run: it waited for something."""
        blocked_s = self.wall_s - self.processor_s - self.queued_s
        return max(0.0, blocked_s / self.wall_s) if self.wall_s > 0 else 0.0


@dataclass
class ThreadTimes:
    """Looks at the threads of a program from time to time; it costs the program nothing."""

    # by process and thread: when it was, and the seconds that the thread ran and was queued
    _first: dict[tuple[int, int], tuple[float, float, float]] = field(default_factory=dict)
    _last: dict[tuple[int, int], tuple[float, float, float]] = field(default_factory=dict)

    def look(self, pids: Iterable[int], folder: Path = Path("/proc")) -> None:
        for pid in pids:
            with contextlib.suppress(OSError):
                for task in (folder / str(pid) / "task").iterdir():
                    with contextlib.suppress(OSError, ValueError):
                        ran, queued, _ = map(int, (task / "schedstat").read_text().split())
                        key = pid, int(task.name)
                        self._last[key] = time.monotonic(), 1e-9 * ran, 1e-9 * queued
                        self._first.setdefault(key, self._last[key])

    def times(self) -> Sequence[ThreadTime]:
        return [
            ThreadTime(
                *key, *(end - begin for begin, end in zip(self._first[key], last, strict=True))
            )
            for key, last in self._last.items()
        ]

    def queued_s(self, pid: int) -> float | None:
        """Return for how long the main thread of a process could run, and had no core."""
        of_main = [each.queued_s for each in self.times() if each.pid == each.tid == pid]
        return of_main[0] if of_main else None

    def contending(self) -> int | None:
        """Return the process with most busy threads; None where none has two."""
        busy = [each.pid for each in self.times() if each.is_busy]
        most = max(set(busy), key=busy.count, default=None)
        return most if most is not None and busy.count(most) > 1 else None


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
    pid: NonNegativeInt
    share: Share
    holder: str
    holder_share: Share
    place: Place


def gil_waits(
    times: Sequence[ThreadTime], threads: Sequence[ThreadSamples], holders: Holders | None
) -> list[GilWait]:
    """Return the threads that wait for the GIL, those that wait longest first."""
    if holders is None or not holders.samples:
        return []
    holders_by_tid = {each.thread.tid: each for each in holders.threads if each.stacks}
    if sum(len(each.stacks) for each in holders_by_tid.values()) < LEAST_HOLDER_SAMPLES:
        return []
    by_tid = {(each.pid, each.tid): each for each in times if each.is_busy}
    waits = []
    for thread in _merged(threads):
        own_time = by_tid.get((thread.thread.pid, thread.thread.tid))
        others = [each for tid, each in holders_by_tid.items() if tid != thread.thread.tid]
        if own_time is None or own_time.pid != holders.pid or not others:
            continue
        most = max(others, key=lambda each: len(each.stacks))
        by_others = sum(len(each.stacks) for each in others) / holders.samples
        share = min(own_time.blocked_share - _waiting_share(thread), by_others)
        place = _place(most.stacks)
        if share >= LEAST_SHARE and place is not None:
            holder_share = min(1.0, len(most.stacks) / holders.samples)
            name, holder = thread.thread.name, most.thread.name
            waits.append(GilWait(name, own_time.pid, share, holder, holder_share, place))
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
    if not thread.stacks:
        return 0.0
    waiting = sum(
        activities.steps_on_threads(stack) or activities.activity(stack) not in _RUNNING
        for stack in thread.stacks
    )
    return waiting / len(thread.stacks)


def _place(stacks: Sequence[Sequence[Frame]]) -> Place | None:
    own = (next((frame for frame in reversed(stack) if is_own(frame)), None) for stack in stacks)
    lines = Counter(each for each in own if each is not None)
    return next((activities.place_of(frame) for frame, _ in lines.most_common(1)), None)
