"""What comparisons show together: which changes remain when one allows for their number.

Of many comparisons of targets that do not differ, one is called slower or faster sooner or later.
So a change of a family of comparisons needs an e-value that suffices for their number (see
`launch_stats.e_benjamini_hochberg`).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from mjbench.measuring import launch_stats
from mjbench.paired.metrics import METRICS
from mjbench.paired.outcomes import CONFIDENCE, MIN_EFFECT, Cause, Verdict
from mjbench.paired.records import VerdictRow
from mjbench.results.runs import RunHeader


@dataclass(frozen=True)
class Family:
    """What is certain about the comparisons of a family.

    Attributes:
      undecided: those that are inconclusive or failed, or whose change is not certain enough for
        their number or may be due to where code lies.
    """

    slower: Sequence[VerdictRow]
    faster: Sequence[VerdictRow]
    undecided: Sequence[VerdictRow]
    count: int


def confidence_of(header: RunHeader) -> float:
    confidence = header.arguments.get("confidence")
    if isinstance(confidence, float) and 0 < confidence < 1:
        return confidence
    return CONFIDENCE


def rule_of(header: RunHeader) -> tuple[float, float]:
    """Return the confidence, and the smallest effect, that the command of a run was given."""
    min_effect = header.arguments.get("min_effect")
    if not (isinstance(min_effect, float) and 0 < min_effect < 1):
        min_effect = MIN_EFFECT
    return confidence_of(header), min_effect


def adjust_for_family(rows: Sequence[VerdictRow], confidence: float) -> Family:
    """Return what comparisons show together.

    Args:
      confidence: of the slower ones that are named, a share of at most
        1 - confidence is expected to be false alarms, and so of the faster ones.
    """
    changes: dict[Verdict, list[VerdictRow]] = {}
    for verdict in (Verdict.SLOWER, Verdict.FASTER):
        e_values = [e_value(row, verdict) for row in rows]
        certain = launch_stats.e_benjamini_hochberg(e_values, 1 - confidence)
        changes[verdict] = [row for row, is_sure in zip(rows, certain, strict=True) if is_sure]
    slower, faster = changes[Verdict.SLOWER], changes[Verdict.FASTER]
    decided = [*slower, *faster, *(row for row in rows if row.verdict == Verdict.SAME)]
    undecided = [row for row in rows if not any(row is other for other in decided)]
    return Family(slower, faster, undecided, len(rows))


def e_value(row: VerdictRow, verdict: Verdict) -> float:
    """Return the evidence for a verdict; 0 where a comparison has another, or may be placement.

    Instruction counts, which have no noise, are certain.
    """
    if row.verdict != verdict or may_be_placement(row):
        return 0.0
    if METRICS[row.metric].is_exact:
        return math.inf
    return (row.e_slower if verdict == Verdict.SLOWER else row.e_faster) or 0.0


def may_be_placement(row: VerdictRow) -> bool:
    """Return whether times differ, and it could not be averaged out where the code lies."""
    could_not_average = row.placement is not None and bool(row.placement.problem)
    return could_not_average and row.cause == Cause.UNDECIDED
