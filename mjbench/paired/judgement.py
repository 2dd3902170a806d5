"""What launches show about two targets: the verdict, its interval, and whether they are enough."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mjbench.measuring import anytime
from mjbench.measuring.anytime import Evidence, Interval
from mjbench.measuring.ratio import Ratio
from mjbench.paired.outcomes import Verdict

# A verdict of faster or slower is final when its interval's half-width is at most this share of the
# change.
SHARE = 0.8
# Fewer launches give no verdict, however clear: of launches in two modes, the first six are of one
# mode in 3 % of comparisons, the first eight in 0.8 %. With placements, it is two of each residue.
MIN_LAUNCHES = 8


@dataclass(frozen=True)
class Judgement:
    """What launches show about the ratio of candidate time to baseline time.

    Attributes:
      enough: whether more launches are unnecessary for the verdict and precision asked for.
      e_slower: e-value against "not slower" (see `anytime.Fit.e_values`); 1 or less is no evidence.
    """

    verdict: Verdict
    ratio: Ratio
    launches: int
    enough: bool
    e_slower: float = 1.0
    e_faster: float = 1.0


def judge(
    log_ratios: Sequence[float],
    min_effect: float,
    confidence: float,
    precision: float,
    residues: Sequence[int] | None = None,
    family: int = 1,
) -> Judgement:
    """Judge launches, each the natural logarithm of candidate time over baseline time.

    The verdict is `same` if the whole interval is within the smallest effect that matters. It is
    `slower` or `faster` if the interval excludes "no change" and the estimate is nearer to that
    effect than to no change.

    Launches are enough if the verdict is `same`, or if the interval's half-width is at most a SHARE
    of the change (to stop as soon as the interval excludes "no change" would overstate the change).
    They are also enough if the half-width is at most `precision`, or half of the smallest effect if
    that is less. In a family of comparisons, `slower` and `faster` need more: an e-value that
    suffices for any number of changes in the family (see `anytime.e_benjamini_hochberg`).

    Args:
      confidence: of the whole procedure, however often it is called.
      residues: of the launches' placements; None if libraries stay where they are.
    """
    evidence = anytime.evidence(log_ratios, confidence, residues)
    return conclude(evidence, min_effect, confidence, precision, family)


def judge_exact(log_ratio: float, min_effect: float) -> Judgement:
    """Judge a ratio that has no noise: one launch decides."""
    ratio = math.exp(log_ratio)
    return Judgement(exact_verdict(ratio, min_effect), Ratio(ratio, ratio, ratio), 1, enough=True)


def exact_verdict(ratio: float, min_effect: float) -> Verdict:
    if ratio >= 1 + min_effect:
        return Verdict.SLOWER
    return Verdict.FASTER if ratio <= 1 / (1 + min_effect) else Verdict.SAME


def conclude(
    evidence: Evidence, min_effect: float, confidence: float, precision: float, family: int = 1
) -> Judgement:
    """Judge what launches show; see `judge` for the rule and the other arguments."""
    interval = evidence.interval
    log_effect = float(np.log1p(min_effect))
    has_launches = interval.count >= MIN_LAUNCHES
    verdict = _verdict(interval, log_effect) if has_launches else Verdict.INCONCLUSIVE
    # half of the effect: an interval as wide as the effect on both sides could never be `same`
    precise = min(float(np.log1p(precision)), log_effect / 2)
    is_narrow = interval.half_width <= max(precise, abs(interval.mean) * SHARE)
    is_change = verdict in (Verdict.SLOWER, Verdict.FASTER)
    e_value = evidence.e_positive if interval.mean > 0 else evidence.e_negative
    is_sure = not is_change or e_value * (1 - confidence) >= family
    return Judgement(
        verdict,
        Ratio.of_log(interval.mean, interval.half_width),
        interval.count,
        has_launches and (verdict == Verdict.SAME or (is_narrow and is_sure)),
        evidence.e_positive,
        evidence.e_negative,
    )


def _verdict(interval: Interval, log_effect: float) -> Verdict:
    if -log_effect < interval.low and interval.high < log_effect:
        return Verdict.SAME
    if interval.low > 0 and interval.mean > log_effect / 2:
        return Verdict.SLOWER
    if interval.high < 0 and interval.mean < -log_effect / 2:
        return Verdict.FASTER
    return Verdict.INCONCLUSIVE
