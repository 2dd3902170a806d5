"""Estimates from raw samples; pure functions.

Speed-ups are ratios within a round, where both sides saw the same machine. Their centre is the
median and their interval comes from order statistics, which assumes nothing about the shape of
the noise (P. Conover, Practical Nonparametric Statistics, section 3.2).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

CONFIDENCE = 0.95


@dataclass(frozen=True)
class Estimate:
    """A median with its interval; the ends are None where samples are too few for one."""

    median: float
    low: float | None
    high: float | None


def speedup(base_s: Sequence[float], other_s: Sequence[float]) -> Estimate:
    """Return how many times faster `other_s` is than `base_s`, round by round.

    Args:
      base_s: seconds of the base in each round.
      other_s: seconds of the other side in the same rounds.

    Raises:
      ValueError: the two differ in length, or are empty.
    """
    if len(base_s) != len(other_s) or not base_s:
        raise ValueError(f"need samples of the same rounds, got {len(base_s)} and {len(other_s)}")
    ratios = np.log(np.asarray(base_s)) - np.log(np.asarray(other_s))
    low, high = median_interval(ratios)
    return Estimate(
        float(np.exp(np.median(ratios))),
        None if low is None else float(np.exp(low)),
        None if high is None else float(np.exp(high)),
    )


def median_interval(
    samples: np.ndarray, confidence: float = CONFIDENCE
) -> tuple[float | None, float | None]:
    """Return the interval of the median of independent samples, by order statistics.

    The ends are None with fewer samples than the confidence needs (six for 95 %).
    """
    from scipy import stats

    interval = stats.quantile_test(samples, p=0.5).confidence_interval(confidence)
    low, high = float(interval.low), float(interval.high)
    return (None if np.isnan(low) else low), (None if np.isnan(high) else high)
