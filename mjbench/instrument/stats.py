"""Estimates from raw samples; pure functions.

Speed-ups are ratios within a round, where both sides saw the same machine. Their centre is the
median and their interval comes from order statistics, which assumes nothing about the shape of
the noise (P. Conover, Practical Nonparametric Statistics, section 3.2).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from mjbench.errors import InputError

CONFIDENCE = 0.95
# Variance of the prior on mean over deviation: the interval is narrowest where the effect is
# somewhat larger than the deviation between launches, so that ten or twenty of them tell.
PRIOR = 2.0
# A verdict of faster or slower stands when its interval's half-width is this share of the change.
SHARE = 0.8
# Share of the launches left out at each end.
TRIM = 0.2
# Fewer launches give no verdict, however clear: they would rest on a deviation of a few numbers.
LEAST_LAUNCHES = 6


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


@dataclass(frozen=True)
class TimedBlocks:
    """Seconds of blocks of the same work, and what they were taken with.

    Attributes:
      seconds: of each block.
      identity: what must not differ between results that are compared, by name.
    """

    seconds: Sequence[float]
    identity: Mapping[str, object]


def unpaired(base: TimedBlocks, other: TimedBlocks, across: bool = False) -> Estimate:
    """Return how many times faster `other` is than `base`, taken at another time.

    The interval is made of both medians' own, each at the confidence that leaves 95 % for both
    (Bonferroni); it knows nothing of what changed on the machine between.

    Args:
      base: seconds of the base.
      other: of the other side.
      across: compare even what differs in identity.

    Raises:
      InputError: the two differ in identity.
    """
    differing = [
        f"{name} ({base.identity.get(name)}, {other.identity.get(name)})"
        for name in sorted({*base.identity, *other.identity})
        if base.identity.get(name) != other.identity.get(name)
    ]
    if differing and not across:
        raise InputError(f"not comparable, they differ in {', '.join(differing)}")
    confidence = 1 - (1 - CONFIDENCE) / 2
    logs = [np.log(np.asarray(side.seconds)) for side in (base, other)]
    ends = [median_interval(values, confidence) for values in logs]
    (base_low, base_high), (other_low, other_high) = ends
    known = None not in (base_low, base_high, other_low, other_high)
    return Estimate(
        float(np.exp(np.median(logs[0]) - np.median(logs[1]))),
        float(np.exp(base_low - other_high)) if known else None,  # type: ignore[operator]
        float(np.exp(base_high - other_low)) if known else None,  # type: ignore[operator]
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


@dataclass(frozen=True)
class Interval:
    """A trimmed mean with an interval that stays valid however often one looked before stopping.

    Attributes:
      mean: of the samples.
      low: lower end; minus infinity with too few samples.
      high: upper end; infinity with too few samples.
      count: samples.
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

    Whoever computes it after every new sample, and stops when he likes, is wrong about the centre
    at any look with a probability of about 1 - confidence. It holds what the t-test's Bayes
    factor with right-Haar prior on the deviation and a normal prior of variance PRIOR on mean over
    deviation does not reject at 1 / (1 - confidence); for normal samples that factor is a test
    martingale, and the bound exact (Pérez-Ortiz, Lardy, de Heij and Grünwald, E-statistics, group
    invariance and anytime-valid testing, Annals of Statistics 52, 2024; the factor: Gönen, Johnson,
    Lu and Westfall, The American Statistician 59, 2005).

    A launch disturbed by another process is off by ten times what others are. So a share TRIM of
    the samples is left out at each end, and mean and error are those of Yuen (Biometrika 61, 1974),
    which behave as a mean of the samples left. tests/test_stats.py simulates both kinds of noise.

    Raises:
      ValueError: no samples, or a confidence not between 0 and 1.
    """
    if not samples or not 0 < confidence < 1:
        raise ValueError(f"need samples and a confidence in (0, 1), got {confidence}")
    values = np.sort(np.asarray(samples, dtype=float))
    count = len(values)
    cut = int(TRIM * count)
    left = count - 2 * cut
    mean = float(values[cut : count - cut].mean())
    growth = 1 + left * PRIOR
    # the factor reaches 1 / (1 - confidence) where (1 + u) / (1 + u / growth) is `ratio`,
    # u being t² over the degrees of freedom
    ratio = (np.sqrt(growth) / (1 - confidence)) ** (2 / left)
    if left < 2 or ratio >= growth:
        return Interval(mean, -np.inf, np.inf, count)
    winsorized = np.clip(values, values[cut], values[count - cut - 1])
    error = np.sqrt((count - 1) * winsorized.var(ddof=1) / (left * (left - 1)))
    u = (ratio - 1) / (1 - ratio / growth)
    half = float(error * np.sqrt((left - 1) * u))
    return Interval(mean, mean - half, mean + half, count)


class Verdict(StrEnum):
    """What a paired comparison decides of the candidate."""

    FASTER = "faster"
    SLOWER = "slower"
    SAME = "same"
    """Within the smallest effect that matters."""
    INCONCLUSIVE = "inconclusive"


@dataclass(frozen=True)
class Judgement:
    """What launches say of candidate over baseline time.

    Attributes:
      verdict: the decision so far.
      ratio: estimate of new time over old time.
      low: lower end of its interval.
      high: upper end of its interval.
      launches: that it rests on.
      enough: whether further launches would change nothing that was asked for.
    """

    verdict: Verdict
    ratio: float
    low: float
    high: float
    launches: int
    enough: bool


def judge(
    log_ratios: Sequence[float], min_effect: float, confidence: float, precision: float
) -> Judgement:
    """Judge launches, each a natural logarithm of new time over old time.

    `same`: the whole interval lies within the smallest effect that matters. `slower`, `faster`:
    the interval excludes no change, and the estimate is nearer to that effect than to none. It is
    enough when it is `same`, when the half-width is within a SHARE of the change (stopping as soon
    as it excludes none would overstate the change), and in any case when it is within `precision`,
    or half of the smallest effect where that is less.

    Args:
      log_ratios: one a launch.
      min_effect: smallest effect that matters, such as 0.01.
      confidence: such as 0.99; of the whole procedure, however often it is called.
      precision: such as 0.005.
    """
    interval = anytime_interval(log_ratios, confidence)
    matters = float(np.log1p(min_effect))
    if -matters < interval.low and interval.high < matters:
        verdict = Verdict.SAME
    elif interval.low > 0 and interval.mean > matters / 2:
        verdict = Verdict.SLOWER
    elif interval.high < 0 and interval.mean < -matters / 2:
        verdict = Verdict.FASTER
    else:
        verdict = Verdict.INCONCLUSIVE
    # `same` needs room on both sides of no change
    asked = min(float(np.log1p(precision)), matters / 2)
    narrow = max(asked, abs(interval.mean) * SHARE)
    enough = interval.count >= LEAST_LAUNCHES and (
        verdict == Verdict.SAME or interval.half_width <= narrow
    )
    return Judgement(
        verdict if interval.count >= LEAST_LAUNCHES else Verdict.INCONCLUSIVE,
        float(np.exp(interval.mean)),
        float(np.exp(interval.low)),
        float(np.exp(interval.high)),
        interval.count,
        enough,
    )
