"""From how many simulations on an accelerated path overtakes the best C path."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mjbench.commands.compare.results import PathResult
from mjbench.measuring.stats import CONFIDENCE
from mjbench.units import plain
from mjbench.verification.plan import Variant

# The speeds of fewer sizes show no scatter about their curve.
_MIN_SIZES = 5
# The curve: the logarithm of the share as a polynomial of this degree in that of the size.
_DEGREE = 2


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


def _overtakes_at(shares: Sequence[tuple[int, float]]) -> int | None:
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
