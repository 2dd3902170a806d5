"""Which core a launch runs on, and how processes are kept on it."""

import contextlib
import math
import random
import time
from collections.abc import Collection, Iterable, Iterator, Mapping

from mjbench.instrument import platforms, topology

# The cores that this process may use; read before it pins itself to one of them.
USABLE = platforms.affinity()
# Cores that `freest_cores` looks at, at most.
_MAX_TRIED = 8
# Launches that are measured at the same time, at most: more may not be independent
# (docs/method/paired.md, "Launches").
_MAX_AT_ONCE = 1
# Shares of a core's time that differ by less are equal. So a core is free if a process gets all of
# its time but this share.
_SHARE_RESOLUTION = 0.02


def launches_at_once(most: int = _MAX_AT_ONCE) -> int:
    """Return how many launches are measured at the same time, at most, each on one core.

    They take up to half of the cores, since the processes of the next launches start on the others.
    It is one where the system cannot keep processes on a core, or does not say what its cores are.

    Args:
      most: launches, whatever the cores.
    """
    if not USABLE:
        return 1
    machine_cores = topology.read(USABLE)
    count = machine_cores.cores or 1
    if machine_cores.quota_cores is not None:
        count = min(count, math.floor(machine_cores.quota_cores))
    return min(max(1, count // 2), most)


def beside(chosen: Collection[int]) -> set[int]:
    """Return the cores for processes that start while launches are measured on some others.

    They are not hyper-threads of these, unless there are no others, and no more than the quota of
    the control group allows beside them: it would stop the launches, too.
    """
    siblings = set().union(*map(topology.siblings, chosen))
    others = USABLE - set(chosen) - siblings or USABLE - set(chosen)
    quota = topology.read(USABLE).quota_cores
    if quota is None:
        return others
    most = max(1, math.floor(quota) - len(chosen))
    return set(sorted(others)[:most])


def freest_cores(most: int = 1, probe_s: float = 0.01) -> list[int]:
    """Return usable cores that other processes leave alone, or use least if there is none.

    A busy loop runs on some cores, one after the other in random order, until it got nearly all the
    time of enough of them. Where that never happens, those where it got the largest share are
    returned. The loop lasts longer than Linux lets a newcomer run before others get their turn,
    which is some milliseconds.

    Args:
      most: cores to return at most. No two of them are hyper-threads of one core.
      probe_s: seconds of the busy loop on each core.

    Returns:
      One core or more; none if this system cannot tell.
    """
    allowed = sorted(platforms.affinity())
    if not allowed:
        return []
    shares: dict[int, float] = {}
    for core in random.sample(allowed, min(len(allowed), _MAX_TRIED)):
        shares[core] = _share(core, probe_s)
        free = _on_different_cores(_at_least(1 - _SHARE_RESOLUTION, shares))
        if len(free) >= most:
            return free
    best = max(shares.values())
    return _on_different_cores(_at_least(best - _SHARE_RESOLUTION, shares))[:most]


def freest_core() -> int | None:
    """Return one core (see `freest_cores`); None if this system cannot tell."""
    return next(iter(freest_cores()), None)


def _share(core: int, probe_s: float) -> float:
    """Return which share of a core's time a busy loop of so many seconds gets."""
    with pinned(core):
        begin, used = time.perf_counter(), time.thread_time()
        while time.perf_counter() - begin < probe_s:
            pass
        return (time.thread_time() - used) / (time.perf_counter() - begin)


def _at_least(least: float, shares: Mapping[int, float]) -> list[int]:
    """Return the cores of which the busy loop got this share or more."""
    return [core for core, share in shares.items() if share >= least]


def _on_different_cores(threads: Iterable[int]) -> list[int]:
    """Return those hardware threads that share a core with none before them."""
    chosen: list[int] = []
    for thread in threads:
        if not topology.siblings(thread) & set(chosen):
            chosen.append(thread)
    return chosen


def usable(core: int | None) -> list[int]:
    """Return the cores that a process may use: one, or all where none was chosen."""
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
        platforms.set_affinity(0, allowed)


def confine(pids: Iterable[int], cores: Collection[int]) -> None:
    """Have processes run on these cores only, where the system can."""
    for pid in pids:
        with contextlib.suppress(OSError):  # it may have ended; its next answer will say so
            platforms.set_affinity(pid, cores)
