"""How much work a call must have before Ray overtakes the paths that need no cluster.

The work of a call is its steps, of all simulations together. Its cost is in milliseconds of the
plain loop, so that models can be compared.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from mjbench.comparison.plan import Variant
from mjbench.paths import BASE
from mjbench.paths.parallelism import WORKER_OPTIONS, nthread
from mjbench.report import formats
from mjbench.report.results import PathResult
from mjbench.units import plain

# The path, and those that it is compared with.
PATH, RIVALS = "ray", (BASE, "rollout", "processes")


@dataclass(frozen=True)
class CallWork:
    """What one call does.

    Attributes:
      steps: of all simulations together.
      loop_ms: milliseconds that the plain loop takes for them.
    """

    steps: int
    loop_ms: float


@dataclass(frozen=True)
class WorkCrossover:
    """Where Ray overtakes another path on one model, by the work of a call.

    Attributes:
      rival: the other path, with its number of threads or processes; at each size, the fastest of
        its variants with that number.
      least: least work from which on Ray is faster at every size; None if it is slower at the
        largest.
      largest: largest work of a call at which both were timed.
      share: Ray's speed over the rival's there.
    """

    model: str
    path: str
    options: Mapping[str, Any]
    rival: Variant
    least: CallWork | None
    largest: CallWork
    share: float


@dataclass(frozen=True)
class _Size:
    """The work of a call at one size, and the results."""

    work: CallWork
    results: Sequence[PathResult]

    def fastest(self, path: str, workers: int) -> PathResult | None:
        """Return a path's fastest variant with this number of threads; None without one."""
        own = [r for r in self.results if (r.path, nthread(r.options)) == (path, workers)]
        return max(own, key=lambda result: result.steps_per_s or 0.0, default=None)


def work_crossovers(results: Sequence[PathResult]) -> list[WorkCrossover]:
    """Return where Ray overtakes each other path, on models measured at two sizes or more."""
    timed = [r for r in results if r.steps_per_s and r.nbatch_asked]
    rows = []
    for model in dict.fromkeys(result.model for result in timed):
        sizes = _sizes([result for result in timed if result.model == model])
        variants = [(r.path, nthread(r.options)) for size in sizes for r in size.results]
        rivals = [v for path in RIVALS for v in sorted({*variants}) if v[0] == path]
        for actors in sorted({workers for path, workers in variants if path == PATH}):
            for path, threads in rivals:
                row = _crossover(sizes, actors, path, threads)
                rows += [row] if row else []
    return rows


def _sizes(results: Sequence[PathResult]) -> list[_Size]:
    """Return the sizes at which the plain loop was timed, those with the least work first."""
    sizes = []
    others = [r for r in results if r.path != BASE]
    for base in (r for r in results if (r.path, r.options) == (BASE, {})):
        same = [base, *(r for r in others if r.nbatch_asked == base.nbatch_asked)]
        assert base.nbatch and base.nstep and base.step_ns, "a timed result has sizes and a time"
        steps = base.nbatch * base.nstep
        sizes.append(_Size(CallWork(steps, 1e-6 * steps * base.step_ns), same))
    return sorted(sizes, key=lambda size: size.work.steps)


def _crossover(
    sizes: Sequence[_Size], actors: int, path: str, threads: int
) -> WorkCrossover | None:
    """Return where `actors` actors overtake a path with `threads` threads; None with one size."""
    shares: list[tuple[CallWork, float]] = []
    largest: tuple[CallWork, PathResult, PathResult] | None = None
    for size in sizes:
        own, rival = size.fastest(PATH, actors), size.fastest(path, threads)
        if rival is None:
            continue
        shares.append((size.work, own.rate_over(rival) if own else 0.0))
        if own is not None:
            largest = size.work, own, rival
    if largest is None or len(shares) < 2:
        return None
    least = None
    for work, share in reversed(shares):
        if share <= 1.0:  # slower there, or it failed
            break
        least = work
    work, own, rival = largest
    return WorkCrossover(
        model=own.model,
        path=own.path,
        options=own.options,
        rival=Variant(path, {n: v for n, v in rival.options.items() if n in WORKER_OPTIONS}),
        least=least,
        largest=work,
        share=own.rate_over(rival),
    )


def describe_work_crossover(row: WorkCrossover) -> str:
    """Return from how much work per call on Ray overtakes another path, as a sentence."""
    begin = f"{row.model}: {Variant(row.path, row.options)}"
    if row.least:
        return f"{begin} overtakes {row.rival} at {_call_work(row.least)}, of those tried"
    text = (
        f"{begin} does not overtake {row.rival} up to {_call_work(row.largest)}, where it has"
        f" {formats.factor(row.share)} of its speed"
    )
    if row.rival.path == "rollout" and nthread(row.rival.options) > 1:
        text += "; on one machine, rollout needs no Ray to use all cores"
    return text


def _call_work(work: CallWork) -> str:
    return f"{work.steps:,} steps per call ({plain(work.loop_ms, 2)} ms of the plain loop)"
