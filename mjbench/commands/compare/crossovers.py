"""From how many simulations on an accelerated path overtakes the best C path."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from mjbench.commands.compare.results import PathResult
from mjbench.formats import plain
from mjbench.verification.plan import Variant


@dataclass(frozen=True)
class Crossover:
    """Where one accelerated path overtakes C on one model.

    Attributes:
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
    rival: Variant
    share: float


def crossovers(results: Sequence[PathResult]) -> list[Crossover]:
    """Return the crossover of each accelerated path that was measured at two sizes or more."""
    timed = [r for r in results if r.steps_per_s and r.nbatch_asked and r.is_judged]
    c_paths = defaultdict[str, list[PathResult]](list)
    for result in sorted(timed, key=lambda result: result.steps_per_s or 0.0):
        if not result.is_accelerated:
            c_paths[result.model].append(result)
    accelerated = defaultdict[tuple[str, str], list[PathResult]](list)
    for result in filter(lambda result: result.is_accelerated, timed):
        accelerated[result.model, str(result.variant)].append(result)
    rows = []
    for (model, _), own in accelerated.items():
        best_c = {
            result.nbatch_asked or 0: result for result in c_paths[model]
        }  # the fastest is last
        shares = {
            size: result.rate_over(best_c[size])
            for result in own
            if (size := result.nbatch_asked or 0) in best_c
        }
        if len(shares) > 1:
            rows.append(_crossover(own[0], shares, best_c))
    return rows


def _crossover(
    result: PathResult, shares: Mapping[int, float], best_c: Mapping[int, PathResult]
) -> Crossover:
    overtakes_at, largest = None, max(shares)
    for size in sorted(best_c, reverse=True):
        if shares.get(size, 0.0) <= 1.0:  # one that failed there is not faster
            break
        overtakes_at = size
    return Crossover(
        model=result.model,
        path=result.path,
        options=result.options,
        nbatch=overtakes_at,
        largest=largest,
        rival=best_c[largest].variant,
        share=shares[largest],
    )


def describe_crossover(row: Crossover) -> str:
    """Return from which batch size on an accelerated path overtakes C, as a sentence."""
    begin = f"{row.model}: {Variant(row.path, row.options)}"
    rival = f"the best C path ({row.rival})"
    if row.nbatch:
        return f"{begin} overtakes {rival} at {row.nbatch:,} simulations of those tried"
    return (
        f"{begin} does not overtake {rival} up to {row.largest:,} simulations, where it has"
        f" {plain(row.share, 2)} of its speed"
    )
