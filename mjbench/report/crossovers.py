"""From how many simulations on an accelerated path overtakes the best C path."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from mjbench.report.results import PathResult


@dataclass(frozen=True)
class Rival:
    """The C path that an accelerated path is compared with."""

    path: str
    options: Mapping[str, Any]


@dataclass(frozen=True)
class Crossover:
    """Where one accelerated path overtakes C on one model.

    Attributes:
      model: its name.
      path: the accelerated path.
      options: of the path.
      nbatch: least number of simulations from which on it is faster at every size; None at none.
      largest: largest number of simulations at which both were timed.
      rival: the best C path there.
      share: of the rival's speed, at the largest size.
    """

    model: str
    path: str
    options: Mapping[str, Any]
    nbatch: int | None
    largest: int
    rival: Rival
    share: float


def crossovers(results: Sequence[PathResult]) -> list[Crossover]:
    """Return the crossover of each accelerated path that was measured at two sizes or more."""
    timed = [r for r in results if r.steps_per_s and r.nbatch_asked and r.is_judged]
    rows = []
    for model in dict.fromkeys(result.model for result in timed):
        of_model = [result for result in timed if result.model == model]
        best_c = _best_c_by_size(of_model)
        accelerated = [result for result in of_model if result.is_accelerated]
        for variant in _variants(accelerated):
            own = [r for r in accelerated if (r.path, r.options) == (variant.path, variant.options)]
            shares = {
                int(r.nbatch_asked or 0): r.rate_over(best_c[int(r.nbatch_asked or 0)])
                for r in own
                if r.nbatch_asked in best_c
            }
            if len(shares) > 1:
                rows.append(_crossover(variant, shares, best_c))
    return rows


def _crossover(
    variant: PathResult, shares: Mapping[int, float], best_c: Mapping[int, PathResult]
) -> Crossover:
    largest, overtakes_at = max(shares), None
    for size in sorted(best_c, reverse=True):
        if shares.get(size, 0.0) <= 1.0:  # slower there, or it failed
            break
        overtakes_at = size
    return Crossover(
        model=variant.model,
        path=variant.path,
        options=variant.options,
        nbatch=overtakes_at,
        largest=largest,
        rival=Rival(best_c[largest].path, best_c[largest].options),
        share=shares[largest],
    )


def _best_c_by_size(results: Sequence[PathResult]) -> dict[int, PathResult]:
    best: dict[int, PathResult] = {}
    for result in results:
        size = int(result.nbatch_asked or 0)
        if not result.is_accelerated and (size not in best or result.rate_over(best[size]) > 1.0):
            best[size] = result
    return best


def _variants(results: Sequence[PathResult]) -> list[PathResult]:
    """Return the first result of each path with its options."""
    keys = [(result.path, result.options) for result in results]
    return [result for i, result in enumerate(results) if keys[i] not in keys[:i]]
