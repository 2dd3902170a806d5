"""Estimate speed-ups and intervals from raw samples; pure functions.

A speed-up is a ratio within a round, so the machine was in the same state for both times. It is
estimated by the median; its interval comes from order statistics, which assume nothing about the
shape of the noise (P. Conover, Practical Nonparametric Statistics, section 3.2).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mjbench.errors import InputError

CONFIDENCE = 0.95
# Variance of the prior on the ratio of mean to deviation. The interval is narrowest where the
# effect is somewhat larger than the deviation between launches: ten or twenty launches suffice.
PRIOR = 2.0
# Share of the launches left out at each end.
TRIM = 0.2


@dataclass(frozen=True)
class Estimate:
    """A median with its interval.

    Attributes:
      median: of the samples.
      low: lower end of the interval; None with too few samples.
      high: upper end of the interval; None with too few samples.
    """

    median: float
    low: float | None
    high: float | None


def speedup(baseline_s: Sequence[float], candidate_s: Sequence[float]) -> Estimate:
    """Return how many times faster the candidate is than the baseline, round by round.

    Args:
      baseline_s: seconds of the baseline in each round.
      candidate_s: seconds of the candidate in the same rounds.

    Raises:
      ValueError: the two differ in length, or are empty.
    """
    counts = len(baseline_s), len(candidate_s)
    if counts[0] != counts[1] or not counts[0]:
        raise ValueError(f"need samples of the same rounds, got {counts[0]} and {counts[1]}")
    log_ratios = np.log(np.asarray(baseline_s)) - np.log(np.asarray(candidate_s))
    low, high = median_interval(log_ratios)
    return Estimate(
        float(np.exp(np.median(log_ratios))),
        None if low is None else float(np.exp(low)),
        None if high is None else float(np.exp(high)),
    )


@dataclass(frozen=True)
class TimedBlocks:
    """Times of blocks of the same work, and the circumstances they were measured in.

    Attributes:
      seconds: of each block.
      identity: circumstances, by name, in which results must not differ to be comparable.
    """

    seconds: Sequence[float]
    identity: Mapping[str, object]


def unpaired(baseline: TimedBlocks, candidate: TimedBlocks, across: bool = False) -> Estimate:
    """Return how many times faster the candidate is than a baseline measured at another time.

    The interval combines the intervals of both medians, each at the confidence that leaves 95 % for
    both together (Bonferroni). It does not account for changes of the machine in between.

    Args:
      baseline: times of the baseline.
      candidate: times of the candidate.
      across: compare even results that differ in identity.

    Raises:
      InputError: the two differ in identity.
    """
    differing = [
        f"{name} ({baseline.identity.get(name)}, {candidate.identity.get(name)})"
        for name in sorted({*baseline.identity, *candidate.identity})
        if baseline.identity.get(name) != candidate.identity.get(name)
    ]
    if differing and not across:
        raise InputError(f"not comparable, they differ in {', '.join(differing)}")
    confidence = 1 - (1 - CONFIDENCE) / 2
    logs = [np.log(np.asarray(blocks.seconds)) for blocks in (baseline, candidate)]
    (baseline_low, baseline_high), (candidate_low, candidate_high) = (
        median_interval(values, confidence) for values in logs
    )
    low = high = None
    if baseline_low is not None and candidate_high is not None:
        low = float(np.exp(baseline_low - candidate_high))
    if baseline_high is not None and candidate_low is not None:
        high = float(np.exp(baseline_high - candidate_low))
    median = float(np.exp(np.median(logs[0]) - np.median(logs[1])))
    return Estimate(median, low, high)


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


@dataclass(frozen=True)
class Interval:
    """A trimmed mean with an anytime-valid interval (see `anytime_interval`).

    Attributes:
      mean: trimmed mean of the samples.
      low: lower end; minus infinity with too few samples.
      high: upper end; infinity with too few samples.
      count: number of samples.
    """

    mean: float
    low: float
    high: float
    count: int

    @property
    def half_width(self) -> float:
        """Half of its width."""
        return (self.high - self.low) / 2


def anytime_interval(samples: Sequence[float], confidence: float) -> Interval:
    """Return the trimmed mean of independent samples with its anytime-valid interval.

    The interval may be computed after every new sample, and sampling stopped at any time: the
    probability that any of these intervals misses the centre is about 1 - confidence. It contains
    the values that the t-test's Bayes factor, with right-Haar prior on the deviation and a normal
    prior of variance PRIOR on the ratio of mean to deviation, does not reject at
    1 / (1 - confidence). For normal samples that factor is a test martingale, and the bound is
    exact (Pérez-Ortiz, Lardy, de Heij and Grünwald, E-statistics, group invariance and
    anytime-valid testing, Annals of Statistics 52, 2024; the factor: Gönen, Johnson, Lu and
    Westfall, The American Statistician 59, 2005).

    A launch that another process disturbed is off by ten times as much as others. So a share TRIM
    of the samples is left out at each end, and mean and error are those of Yuen (Biometrika 61,
    1974), which behave like those of the remaining samples. tests/instrument/test_stats.py
    simulates both kinds of noise.

    Args:
      samples: independent samples.
      confidence: such as 0.99.

    Raises:
      ValueError: no samples, or a confidence not between 0 and 1.
    """
    if not samples or not 0 < confidence < 1:
        raise ValueError(f"need samples and a confidence in (0, 1), got {confidence}")
    values = np.sort(np.asarray(samples, dtype=float))
    count = len(values)
    cut = int(TRIM * count)
    left = count - 2 * cut  # samples that remain
    mean = float(values[cut : count - cut].mean())
    growth = 1 + left * PRIOR
    # The factor reaches 1 / (1 - confidence) where (1 + u) / (1 + u / growth) equals `ratio`; u is
    # t² divided by the degrees of freedom.
    ratio = (np.sqrt(growth) / (1 - confidence)) ** (2 / left)
    if left < 2 or ratio >= growth:
        return Interval(mean, -np.inf, np.inf, count)
    winsorized = np.clip(values, values[cut], values[count - cut - 1])
    error = np.sqrt((count - 1) * winsorized.var(ddof=1) / (left * (left - 1)))
    u = (ratio - 1) / (1 - ratio / growth)
    half_width = float(error * np.sqrt((left - 1) * u))
    return Interval(mean, mean - half_width, mean + half_width, count)
