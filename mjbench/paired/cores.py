"""Which core a launch runs on, and how processes are kept on it."""

import contextlib
import random
import time
from collections.abc import Collection, Iterable, Iterator

from mjbench.instrument import platforms

# The cores that this process may use; read before it pins itself to one of them.
USABLE = platforms.affinity()
# Cores that `freest_core` looks at, at most.
_MAX_TRIED = 8
# Shares of the time that differ by less are equal.
_SHARE_RESOLUTION = 0.02


def freest_core(probe_s: float = 0.01) -> int | None:
    """Return the usable core that other processes use least; None if this system cannot tell.

    A busy loop runs on each core in turn; the freest one is where it got the largest share of the
    time. The loop lasts longer than Linux lets a newcomer run before others get their turn, which
    is some milliseconds.

    Args:
      probe_s: seconds of the busy loop on each core.
    """
    allowed = sorted(platforms.affinity())
    if not allowed:
        return None
    shares: dict[int, float] = {}
    for core in random.sample(allowed, min(len(allowed), _MAX_TRIED)):
        with pinned(core):
            begin, used = time.perf_counter(), time.thread_time()
            while time.perf_counter() - begin < probe_s:
                pass
            shares[core] = (time.thread_time() - used) / (time.perf_counter() - begin)
    best = max(shares.values())
    return random.choice([c for c, share in shares.items() if share > best - _SHARE_RESOLUTION])


def usable(core: int | None) -> list[int]:
    """Return the cores that a process may use: one, or all where none was chosen."""
    return sorted(USABLE) if core is None else [core]


@contextlib.contextmanager
def pinned(core: int | None) -> Iterator[None]:
    """Keep this process on one core while the block runs; None leaves it where it is."""
    if core is None:
        yield
        return
    allowed = platforms.affinity()
    platforms.set_affinity(0, [core])
    try:
        yield
    finally:
        platforms.set_affinity(0, allowed)


def confine(pids: Iterable[int], cores: Collection[int]) -> None:
    """Have processes run on these cores only, where the system can."""
    for pid in pids:
        with contextlib.suppress(OSError):  # it may have ended; its next answer will say so
            platforms.set_affinity(pid, cores)
