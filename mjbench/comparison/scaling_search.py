"""Which run of a search for the number of threads comes next.

Numbers of threads are tried first, from one to twice as many as can run at once: by factors of two,
then between those around the best. With the smallest number that is about as fast as any (the
knee), chunk sizes are tried, and then numbers of simulations.
"""

import dataclasses
import math
import statistics
from collections.abc import Generator, Mapping, Sequence

from mjbench import paths
from mjbench.comparison.plan import Variant
from mjbench.comparison.scaling import (
    ScalingPoint,
    ScalingRecord,
    ScalingRequest,
    ScalingRun,
    Stage,
    knees,
    points,
    speedups_by_threads,
)
from mjbench.status import Status

# Between two numbers of threads whose ratio is below this, none is tried.
_MIN_RATIO = 1.3
# Factor from one chunk size, or number of simulations, to the next.
_FACTOR = 4
# More simulations are tried up to so many, and while a block of the plain loop takes no longer.
MAX_NBATCH, LONG_BLOCK_S = 4096, 0.3
# The time of a run of each stage, as a factor of the budget of a comparison.
_BUDGET_FACTORS = {Stage.THREADS: 0.5, Stage.CHUNK: 0.25, Stage.NBATCH: 0.25}
# Runs that a search usually has, for a bar of progress.
_USUAL_RUNS = 8


# What a search yields are runs to make; it is sent their records.
Search = Generator[ScalingRun, ScalingRecord, None]


def share_done(completed: int, share: float) -> float:
    """Return the share of a search that is done, roughly, from 0 to 1.

    Args:
      completed: runs that ended.
      share: of the next one that is done.
    """
    return min(1.0, (completed + share) / _USUAL_RUNS)


def search(request: ScalingRequest) -> Search:
    """Yield the runs of a search on one model, one after the other; each needs the one before.

    It ends early where a run fails.
    """
    known = yield from _search_threads(request)
    if not known:
        return
    enough, nstep = knees(known), known[0].nstep
    if not enough:  # no path was timed with one thread
        return
    yield from _search_chunks(request, enough, nstep)
    yield from _search_nbatch(request, enough, known)


def _search_threads(
    request: ScalingRequest,
) -> Generator[ScalingRun, ScalingRecord, list[ScalingPoint]]:
    """Return the points of all numbers of threads; none where a run fails."""
    known: list[ScalingPoint] = []
    pending = dict.fromkeys(request.path_names, request.first_counts)
    while pending:
        variants = [
            request.variant(name, count)
            for name, counts in pending.items()
            for count in sorted({1, *counts})
        ]
        nstep = known[0].nstep if known else request.plan.nstep
        record = yield _run(request, Stage.THREADS, variants, request.first_nbatch, nstep)
        if record.model.status != Status.OK:
            return []
        known += points(record)
        pending = {}
        if request.thread_counts is None:
            for name, speedups in speedups_by_threads(known).items():
                if between := _between(speedups):
                    # the best once more, to compare with
                    pending[name] = [max(speedups, key=speedups.__getitem__), *between]
    return known


def _between(speedups: Mapping[int, float]) -> list[int]:
    """Return numbers of threads between the best and those tried below and above it."""
    tried = sorted(speedups)
    best = tried.index(max(speedups, key=speedups.__getitem__))
    gaps = [(tried[i], tried[i + 1]) for i in (best - 1, best) if 0 <= i < len(tried) - 1]
    return [
        round(math.sqrt(low * high))
        for low, high in gaps
        if high - low > 1 and high / low > _MIN_RATIO
    ]


def _search_chunks(request: ScalingRequest, enough: Mapping[str, int], nstep: int) -> Search:
    """Try chunk sizes with the threads of the knee."""
    nbatch = request.first_nbatch
    sizes = {
        name: _chunk_sizes(request, count, nbatch)
        for name, count in enough.items()
        if count > 1 and any(option.name == "chunk" for option in paths.find(name).options)
    }
    if not any(sizes.values()):
        return
    variants = [
        request.variant(name, count, chunk)
        for name in sizes
        for count, chunk in [
            (1, None),
            (enough[name], None),
            *((enough[name], c) for c in sizes[name]),
        ]
    ]
    yield _run(request, Stage.CHUNK, variants, nbatch, nstep)


def _chunk_sizes(request: ScalingRequest, count: int, nbatch: int) -> list[int]:
    """Return the chunk sizes to try: from one simulation to one chunk a thread."""
    if request.chunk_sizes is not None:
        return list(request.chunk_sizes)
    share = math.ceil(nbatch / count)
    powers = [_FACTOR**i for i in range(int(math.log(share, _FACTOR)) + 1)]
    return sorted({*powers, share})


def _search_nbatch(
    request: ScalingRequest, enough: Mapping[str, int], known: Sequence[ScalingPoint]
) -> Search:
    """Try numbers of simulations with one thread, and with the threads of the knee."""
    nstep = known[0].nstep
    plain_step_s = statistics.median(point.step_s * point.speedup.median for point in known)
    for nbatch in _nbatch_values(request, max(enough.values()), plain_step_s * nstep):
        variants = [
            request.variant(name, count)
            for name, most in enough.items()
            for count in sorted({1, most})
        ]
        record = yield _run(request, Stage.NBATCH, variants, nbatch, nstep)
        if record.model.status != Status.OK:
            return


def _nbatch_values(request: ScalingRequest, count: int, simulation_s: float) -> list[int]:
    """Return the numbers of simulations to try beside the first.

    Args:
      request: what to search.
      count: most threads.
      simulation_s: seconds that the plain loop takes for one simulation.
    """
    first = request.first_nbatch
    if request.nbatch is not None:
        return [n for n in sorted(request.nbatch) if n != first]
    most = min(MAX_NBATCH, int(LONG_BLOCK_S / simulation_s))
    powers = [first * _FACTOR**i for i in range(1, 8)]
    fewer = [first // _FACTOR**i for i in range(1, 8)]
    return sorted([n for n in fewer if n >= count] + [n for n in powers if n <= most])


def _run(
    request: ScalingRequest,
    stage: Stage,
    variants: Sequence[Variant],
    nbatch: int,
    nstep: int | None,
) -> ScalingRun:
    unique = [v for i, v in enumerate(variants) if v not in variants[:i]]
    plan = dataclasses.replace(
        request.plan,
        variants=(Variant(paths.BASE, {}), *unique),
        nbatch=nbatch,
        nstep=nstep,
        budget_s=_BUDGET_FACTORS[stage] * request.plan.budget_s,
        times_clock=False,
        narrows=False,
    )
    return ScalingRun(stage, plan)
