"""Estimate speed-ups and intervals from raw samples; pure functions.

A speed-up is a ratio within a round, so the machine was in the same state for both times. It is
estimated by the median; its interval comes from order statistics, which assume nothing about the
shape of the noise (P. Conover, Practical Nonparametric Statistics, section 3.2).
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from mjbench.interval import Interval

CONFIDENCE = 0.95
# Shorter than any clock resolves, in seconds and in nanoseconds.
_LEAST = 1e-9


def median_of(samples: Sequence[float] | np.ndarray, confidence: float = CONFIDENCE) -> Interval:
    """Return the median of independent samples with its interval, by order statistics.

    Its ends are None with fewer samples than the confidence needs, such as six for 95 %.
    """
    from scipy import stats

    values = np.asarray(samples, dtype=float)
    interval = stats.quantile_test(values, p=0.5).confidence_interval(confidence)
    low, high = (None if np.isnan(end) else float(end) for end in (interval.low, interval.high))
    return Interval(float(np.median(values)), low, high)


def speedup(baseline_s: Sequence[float], candidate_s: Sequence[float]) -> Interval:
    """Return how many times faster the candidate is than the baseline in the same rounds.

    Raises:
      ValueError: the two differ in length, or are empty.
    """
    counts = len(baseline_s), len(candidate_s)
    if counts[0] != counts[1] or not counts[0]:
        raise ValueError(f"need samples of the same rounds, got {counts[0]} and {counts[1]}")
    return median_of(logarithms(baseline_s) - logarithms(candidate_s)).exponential


def logarithms(times: ArrayLike) -> np.ndarray:
    """Return natural logarithms of times, those that a clock did not see as finite ones."""
    return np.asarray(np.log(np.maximum(times, _LEAST)))


def pair_log_ratios(orders: Sequence[str], times: np.ndarray) -> np.ndarray:
    """Return (quads, 2) natural logarithms of candidate over baseline time.

    The first column holds the pairs that the baseline began, the second those that the candidate
    began.

    Args:
      orders: `ABBA` or `BAAB` of each quad; A is the baseline.
      times: (quads, 4) of each block, in the order they ran.
    """
    logs = logarithms(times)
    sign = np.array([[1 if letter == "B" else -1 for letter in order] for order in orders])
    pairs = (logs * sign).reshape(-1, 2, 2).sum(axis=2)
    candidate_first = np.array([order[0] == "B" for order in orders])
    pairs[candidate_first] = pairs[candidate_first, ::-1]
    return np.asarray(pairs)


def paired_log_ratio(orders: Sequence[str], times: np.ndarray) -> float:
    """Return the log ratio of quads: the median of the pairs of each order, and their mean.

    The block that comes second is slower, so both orders must weigh the same. A disturbed block
    spoils its pair; a quad has twice as many blocks, and would be spoilt twice as often.
    """
    return float(np.median(pair_log_ratios(orders, times), axis=0).mean())


def blocks_by_target(orders: Sequence[str], times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (quads, 2) times of the baseline, and of the candidate; see `pair_log_ratios`."""
    is_baseline = np.array([[letter == "A" for letter in order] for order in orders])
    return times[is_baseline].reshape(-1, 2), times[~is_baseline].reshape(-1, 2)


def total_log_ratio(orders: Sequence[str], times: np.ndarray, parts: np.ndarray) -> float:
    """Return the log ratio of work that was timed in parts.

    It is the log ratio of the sums over parts, so a part that takes longer weighs more. The log
    ratio of a part is the median of its pairs of both orders, after the effect of the order is
    removed. This effect is estimated from all parts together, because each has few pairs: it is
    half of the median difference of the two pairs of a quad. `parts` has the number of the part
    that each quad timed.
    """
    pairs = pair_log_ratios(orders, times)
    order_effect = np.median(pairs[:, 0] - pairs[:, 1]) / 2
    aligned = pairs - [order_effect, -order_effect]
    baseline, candidate = blocks_by_target(orders, logarithms(times))
    masks = [parts == number for number in np.unique(parts)]
    half_ratios = np.array([np.median(aligned[m]) / 2 for m in masks])
    # robust geometric means of both targets' times
    centers = np.array([(np.median(baseline[m]) + np.median(candidate[m])) / 2 for m in masks])
    total = np.logaddexp.reduce(centers + half_ratios)
    return float(total - np.logaddexp.reduce(centers - half_ratios))


def speedup_in_common(baseline_s: Sequence[float], candidate_s: Sequence[float]) -> Interval:
    """Return the speed-up in the rounds that both have, which are the first of each."""
    count = min(len(baseline_s), len(candidate_s))
    return speedup(baseline_s[:count], candidate_s[:count])
