"""From which size on a path overtakes others: an accelerated path, and Ray.

Of an accelerated path, the size is the number of simulations, and the other is the best C path. Of
Ray, it is the work of a call: its steps, of all simulations together. Its cost is in milliseconds
of the plain loop, so that models can be compared.
"""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from mjbench.comparison.plan import Variant
from mjbench.measuring.stats import CONFIDENCE
from mjbench.paths import BASE
from mjbench.paths.base import WORKER_OPTIONS, nthread
from mjbench.report import formats
from mjbench.report.path_speedups import PathResult
from mjbench.units import plain

# The speeds of fewer sizes show no scatter about their curve.
_MIN_SIZES = 5
# The curve: the logarithm of the share as a polynomial of this degree in that of the size.
_DEGREE = 2
# Ray's path, and those that it is compared with.
RAY, RIVALS = "ray", (BASE, "rollout", "processes")

_Size = TypeVar("_Size")


@dataclass(frozen=True)
class CurveCrossing:
    """Where a smooth curve through the shares of all sizes reaches 1.

    Attributes:
      nbatch: number of simulations; None where it does not within the sizes measured.
      low: lower end of its 95 % interval; None where that is below all sizes.
      high: upper end; None where that is above all sizes.
    """

    nbatch: float | None
    low: float | None
    high: float | None


@dataclass(frozen=True)
class Crossover:
    """Where one accelerated path overtakes C on one model.

    Attributes:
      nbatch: least number of simulations from which on it is faster at every size; None at none.
      largest: largest number of simulations at which both were timed.
      rival: the best C path there.
      share: of the rival's speed, at the largest size.
      curve: the crossing of a curve through all sizes, with its interval; None with fewer than
        five.
    """

    model: str
    path: str
    options: Mapping[str, Any]
    nbatch: int | None
    largest: int
    rival: Variant
    share: float
    curve: CurveCrossing | None = None


def crossovers(results: Sequence[PathResult]) -> list[Crossover]:
    """Return the crossover of each accelerated path that was measured at two sizes or more."""
    timed = [r for r in results if r.steps_per_s and r.nbatch_asked and r.is_judged]
    rows = []
    for model in dict.fromkeys(result.model for result in timed):
        of_model = [result for result in timed if result.model == model]
        best_c = _best_c_by_size(of_model)
        by_variant = defaultdict[str, list[PathResult]](list)
        for result in of_model:
            if result.is_accelerated:
                by_variant[str(result.variant)].append(result)
        for own in by_variant.values():
            shares = {
                size: r.rate_over(best_c[size])
                for r in own
                if (size := r.nbatch_asked or 0) in best_c
            }
            if len(shares) > 1:
                rows.append(_crossover(own[0], shares, best_c))
    return rows


def _crossover(
    result: PathResult, shares: Mapping[int, float], best_c: Mapping[int, PathResult]
) -> Crossover:
    largest = max(shares)
    return Crossover(
        model=result.model,
        path=result.path,
        options=result.options,
        nbatch=_overtakes_at([(size, shares.get(size, 0.0)) for size in sorted(best_c)]),
        largest=largest,
        rival=best_c[largest].variant,
        share=shares[largest],
        curve=curve_crossing(shares),
    )


def _overtakes_at(shares: Sequence[tuple[_Size, float]]) -> _Size | None:
    """Return the least size from which on a path is faster at every size; None at none.

    Args:
      shares: of the other path's speed, by size, the smallest first; 0 where it failed.
    """
    overtakes_at = None
    for size, share in reversed(shares):
        if share <= 1.0:
            break
        overtakes_at = size
    return overtakes_at


def curve_crossing(shares: Mapping[int, float]) -> CurveCrossing | None:
    """Return where a curve through shares of a rival's speed reaches 1, with its 95 % interval.

    The logarithm of the share is fitted by a parabola in the logarithm of the size, by least
    squares; the interval is where the confidence band of that curve covers 1 (inverse regression:
    G. Seber and A. Lee, Linear Regression Analysis, section 6.1.5). Every size was measured in
    processes of its own, so the scatter about the curve includes what differs between processes.

    Args:
      shares: by number of simulations; fewer than five give no interval, and no result.
    """
    from scipy import stats

    if len(shares) < _MIN_SIZES:
        return None
    sizes = np.log(sorted(shares))
    logs = np.log([shares[n] for n in sorted(shares)])
    design = np.vander(sizes, _DEGREE + 1)
    coefficients, *_ = np.linalg.lstsq(design, logs, rcond=None)
    freedom = len(sizes) - _DEGREE - 1
    scatter = float(np.sqrt(np.sum((logs - design @ coefficients) ** 2) / freedom))
    grid = np.linspace(sizes[0], sizes[-1], 1001)
    rows = np.vander(grid, _DEGREE + 1)
    leverage = np.einsum("ij,jk,ik->i", rows, np.linalg.inv(design.T @ design), rows)
    half = stats.t.ppf((1 + CONFIDENCE) / 2, freedom) * scatter * np.sqrt(leverage)
    curve = rows @ coefficients
    return CurveCrossing(*(_ahead_from(grid, line) for line in (curve, curve + half, curve - half)))


def _ahead_from(grid: np.ndarray, line: np.ndarray) -> float | None:
    """Return the size from which on a line stays above 0; None where it does at all or at none."""
    behind = np.flatnonzero(line <= 0.0)
    if len(behind) == 0 or behind[-1] == len(grid) - 1:
        return None
    return float(np.exp(grid[behind[-1] + 1]))


def _best_c_by_size(results: Sequence[PathResult]) -> dict[int, PathResult]:
    best: dict[int, PathResult] = {}
    for result in results:
        size = result.nbatch_asked or 0
        if not result.is_accelerated and (size not in best or result.rate_over(best[size]) > 1.0):
            best[size] = result
    return best


def describe_crossover(row: Crossover) -> str:
    """Return from which batch size on an accelerated path overtakes C, as a sentence."""
    begin = f"{row.model}: {Variant(row.path, row.options)}"
    rival = f"the best C path ({row.rival})"
    if row.nbatch:
        crossing = _curve_crossing(row.curve)
        return f"{begin} overtakes {rival} at {row.nbatch:,} simulations of those tried{crossing}"
    return (
        f"{begin} does not overtake {rival} up to {row.largest:,} simulations, where it has"
        f" {plain(row.share, 2)} of its speed"
    )


def _curve_crossing(curve: CurveCrossing | None) -> str:
    if curve is None or curve.nbatch is None:
        return ""
    low = "fewer than all" if curve.low is None else f"{curve.low:,.0f}"
    high = "more than all" if curve.high is None else f"{curve.high:,.0f}"
    return f"; a curve through all sizes crosses at {curve.nbatch:,.0f} (95 %: {low} to {high})"


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
class _CallSize:
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
        for actors in sorted({workers for path, workers in variants if path == RAY}):
            for path, threads in rivals:
                row = _work_crossover(sizes, actors, path, threads)
                rows += [row] if row else []
    return rows


def _sizes(results: Sequence[PathResult]) -> list[_CallSize]:
    """Return the sizes at which the plain loop was timed, those with the least work first."""
    sizes = []
    others = [r for r in results if r.path != BASE]
    for base in (r for r in results if (r.path, r.options) == (BASE, {})):
        same = [base, *(r for r in others if r.nbatch_asked == base.nbatch_asked)]
        assert base.nbatch and base.nstep and base.step_ns, "a timed result has sizes and a time"
        steps = base.nbatch * base.nstep
        sizes.append(_CallSize(CallWork(steps, 1e-6 * steps * base.step_ns), same))
    return sorted(sizes, key=lambda size: size.work.steps)


def _work_crossover(
    sizes: Sequence[_CallSize], actors: int, path: str, threads: int
) -> WorkCrossover | None:
    """Return where `actors` actors overtake a path with `threads` threads; None with one size."""
    shares: list[tuple[CallWork, float]] = []
    largest: tuple[CallWork, PathResult, PathResult] | None = None
    for size in sizes:
        own, rival = size.fastest(RAY, actors), size.fastest(path, threads)
        if rival is None:
            continue
        shares.append((size.work, own.rate_over(rival) if own else 0.0))
        if own is not None:
            largest = size.work, own, rival
    if largest is None or len(shares) < 2:
        return None
    work, own, rival = largest
    return WorkCrossover(
        model=own.model,
        path=own.path,
        options=own.options,
        rival=Variant(path, {n: v for n, v in rival.options.items() if n in WORKER_OPTIONS}),
        least=_overtakes_at(shares),
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
