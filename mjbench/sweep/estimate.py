"""How long the cells take that are missing: what earlier ones took, else what they may take."""

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from mjbench.comparison.plan import BUDGET_S
from mjbench.paired import outcomes
from mjbench.paired.outcomes import Metric
from mjbench.releases.release_ratios import TARGET_S
from mjbench.sweep.cells import Cell, Kind
from mjbench.sweep.results import Outcome

# What one cell may take, in seconds, where that has a limit that its plan does not set.
_LIMITS_S: Mapping[Kind, float] = {
    Kind.VERSIONS: outcomes.TIME_LIMIT_S,
    Kind.COMPARE: BUDGET_S,
}


@dataclass(frozen=True)
class PartEstimate:
    """What there is to do of one kind of cells.

    Attributes:
      metric: of `versions`; None elsewhere.
      done: how many have a result.
      missing_s: seconds that the others take on one machine; None where that is not known.
      is_limit: whether that is what they may take; else it follows from those that are done.
    """

    kind: Kind
    metric: Metric | None
    cells: int
    done: int
    missing_s: float | None
    is_limit: bool


def estimate(cells: Sequence[Cell], done: Mapping[Cell, Outcome]) -> list[PartEstimate]:
    """Return what there is to do, by kind and metric.

    Args:
      done: how those ended that have a result.
    """
    parts = dict.fromkeys((cell.kind, cell.metric) for cell in cells)
    return [
        _part([cell for cell in cells if (cell.kind, cell.metric) == part], done) for part in parts
    ]


def _part(cells: Sequence[Cell], done: Mapping[Cell, Outcome]) -> PartEstimate:
    first = cells[0]
    missing = [cell for cell in cells if cell not in done]
    known = [done[cell].seconds for cell in cells if cell in done]
    took_s = [seconds for seconds in known if seconds]
    limit_s = None if first.metric == Metric.INSTRUCTIONS else _LIMITS_S.get(first.kind)
    missing_s: float | None = None
    if took_s:
        missing_s = len(missing) * statistics.fmean(took_s)
    elif limit_s is not None:
        missing_s = len(missing) * limit_s
    elif first.kind == Kind.HISTORY:  # all models of a release share its launches
        missing_s = TARGET_S * len({(cell.release, cell.machine) for cell in missing})
    return PartEstimate(
        first.kind,
        first.metric,
        len(cells),
        len(cells) - len(missing),
        missing_s if missing else 0.0,
        is_limit=not took_s,
    )
