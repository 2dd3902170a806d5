"""How long threads run, wait for a core, and are blocked, as Linux accounts for it."""

import contextlib
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

# A thread that runs for less of its time has nothing to wait for.
BUSY_SHARE = 0.05
# Shorter times tell little.
LEAST_S = 0.5


@dataclass(frozen=True)
class ThreadTime:
    """What one thread did between the first and the last look at it.

    Attributes:
      queued_s: for which it could have run, and waited for a core.
    """

    pid: int
    tid: int
    wall_s: float
    processor_s: float
    queued_s: float

    @property
    def is_busy(self) -> bool:
        """Whether it ran for more than a moment."""
        return self.wall_s >= LEAST_S and self.processor_s >= BUSY_SHARE * self.wall_s

    @property
    def blocked_share(self) -> float:
        """The share of its time for which it could not have run: it waited for something."""
        blocked_s = self.wall_s - self.processor_s - self.queued_s
        return max(0.0, blocked_s / self.wall_s) if self.wall_s > 0 else 0.0


@dataclass(frozen=True)
class _Look:
    time_s: float
    processor_s: float
    queued_s: float


@dataclass
class ThreadTimes:
    """Looks at the threads of a program from time to time; it costs the program nothing."""

    _first: dict[tuple[int, int], _Look] = field(default_factory=dict)
    _last: dict[tuple[int, int], _Look] = field(default_factory=dict)

    def look(self, pids: Iterable[int], folder: Path = Path("/proc")) -> None:
        """Look at all threads of processes.

        Args:
          folder: where the system accounts for them; see schedstat in the kernel's documentation.
        """
        for pid in pids:
            with contextlib.suppress(OSError):
                for task in (folder / str(pid) / "task").iterdir():
                    with contextlib.suppress(OSError, ValueError):
                        ran, queued, _ = map(int, (task / "schedstat").read_text().split())
                        key = pid, int(task.name)
                        self._last[key] = _Look(time.monotonic(), 1e-9 * ran, 1e-9 * queued)
                        self._first.setdefault(key, self._last[key])

    def times(self) -> Sequence[ThreadTime]:
        """Return what each thread did."""
        return [
            ThreadTime(
                pid,
                tid,
                last.time_s - first.time_s,
                last.processor_s - first.processor_s,
                last.queued_s - first.queued_s,
            )
            for (pid, tid), last in self._last.items()
            for first in [self._first[pid, tid]]
        ]

    def contending(self) -> int | None:
        """Return the process with most busy threads; None where none has two."""
        busy = [each.pid for each in self.times() if each.is_busy]
        most = max(set(busy), key=busy.count, default=None)
        return most if most is not None and busy.count(most) > 1 else None
