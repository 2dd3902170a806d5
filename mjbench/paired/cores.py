"""Which core a launch runs on, how processes are kept on it, and how many cores threads get."""

import contextlib
import math
import random
import time
from collections.abc import Collection, Iterable, Iterator

from mjbench.host import machine, platforms, topology

# The cores that this process may use; read before it pins itself to one of them.
USABLE = platforms.affinity()
# Cores that `freest_core` looks at, at most.
_MAX_TRIED = 8
# A core is free if a process gets all of its time but this share.
_BUSY_SHARE = 0.02


def beside(core: int) -> set[int]:
    """Return the cores for processes that start while a launch is measured on one.

    They are not its hyper-threads, unless there are no others, and no more than the quota of the
    control group allows beside it: it would stop the launch, too.
    """
    others = USABLE - {core} - topology.siblings(core) or USABLE - {core}
    quota = topology.read(USABLE).quota_cores
    if quota is None:
        return others
    most = max(1, math.floor(quota) - 1)
    return set(sorted(others)[:most])


def freest_core(probe_s: float = 0.01) -> int | None:
    """Return a usable core that other processes leave alone, or use least if there is none.

    A busy loop runs on some cores, one after the other in random order, until it got nearly all the
    time of one. Where that never happens, the core where it got the largest share is returned. The
    loop lasts longer than Linux lets a newcomer run before others get their turn, which is some
    milliseconds. None if this system cannot tell.
    """
    allowed = sorted(platforms.affinity())
    shares: dict[int, float] = {}
    for core in random.sample(allowed, min(len(allowed), _MAX_TRIED)):
        shares[core] = _share(core, probe_s)
        if shares[core] >= 1 - _BUSY_SHARE:
            return core
    return max(shares, key=shares.__getitem__, default=None)


def _share(core: int, probe_s: float) -> float:
    with pinned(core):
        begin, used = time.perf_counter(), time.thread_time()
        while time.perf_counter() - begin < probe_s:
            pass
        return (time.thread_time() - used) / (time.perf_counter() - begin)


def countable(nthread: int) -> int:
    """Return how many cores as many threads can get: those beyond the usable cores do not count."""
    return min(machine.usable_cores(), nthread)


def usable(core: int | None) -> list[int]:
    return sorted(USABLE) if core is None else [core]


@contextlib.contextmanager
def pinned(core: int | None) -> Iterator[None]:
    """Keep this thread on one core while the block runs; None leaves it where it is."""
    if core is None:
        yield
        return
    allowed = platforms.affinity()
    platforms.set_affinity(0, [core])
    try:
        yield
    finally:
        if platforms.affinity() == {core}:  # nobody else has changed it meanwhile
            platforms.set_affinity(0, allowed)


def confine(pids: Iterable[int], cores: Collection[int]) -> None:
    for pid in pids:
        with contextlib.suppress(OSError):  # it may have ended; its next answer will say so
            platforms.set_affinity(pid, cores)
