"""Anytime-valid intervals and e-values of launches, with the placement of code averaged out.

`fit` estimates the mean of launches, with equal weight on each residue (see `placement`), after
leaving out launches that something else on the machine disturbed. An interval or an e-value of it
may be computed after every launch, and launching stopped at any time.
`benchmarks/studies/verdict_simulation.py` measures how often verdicts that rest on them are wrong.
"""

import functools
import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mjbench.interval import Interval

# Variance of the prior on the ratio of mean to deviation. The interval is narrowest where the
# effect is about as large as the deviation between launches; 0.5 and 2 cost 1 to 3 % more launches.
PRIOR = 1.0
# A launch further from its residue's median than this number of deviations may be left out.
DISTURBED = 5.0
# Probability at which so few launches on one side of the median could be one of two equal modes.
SECOND_MODE = 0.001
# Launches beyond these change little of how many may be left out, and take long to count.
MOST_LAUNCHES = 1000


@dataclass(frozen=True)
class Evidence:
    """What a number of launches show about their mean: its interval, and `Fit.e_values`."""

    interval: Interval
    launches: int
    e_positive: float = 1.0
    e_negative: float = 1.0


@dataclass(frozen=True)
class Fit:
    """The means of comparisons, and what their errors follow from; arrays, one entry for each.

    Attributes:
      mean: without the launches that are left out, with equal weight on each residue.
      leverage: variance of the mean, in units of the variance of a launch.
      freedom: degrees of freedom of the variance of a launch.
      squares: sum of squared differences of launches from their residue's mean.
    """

    mean: np.ndarray
    leverage: np.ndarray
    freedom: np.ndarray
    squares: np.ndarray
    left_out: np.ndarray

    @property
    def deviation(self) -> np.ndarray:
        """Standard error of the mean; only with degrees of freedom."""
        return np.asarray(np.sqrt(self.leverage * self.squares / self.freedom))

    def half_width(self, confidence: float) -> np.ndarray:
        """Return half the width of the interval; infinity with too few launches."""
        growth = self._growth
        # The Bayes factor reaches 1 / (1 - confidence) where (1 + u) / (1 + u / growth) equals
        # `ratio`; u is t² divided by the degrees of freedom.
        ratio = (np.sqrt(growth) / (1 - confidence)) ** (2 / (self.freedom + 1))
        is_finite = (self.freedom > 0) & (ratio < growth)
        room = np.where(is_finite, 1 - ratio / growth, 1.0)
        u = np.where(is_finite, (ratio - 1) / room, np.inf)
        half_width: np.ndarray = np.sqrt(np.where(is_finite, self.leverage * self.squares, 1) * u)
        return half_width

    def e_values(self) -> tuple[np.ndarray, np.ndarray]:
        """Return e-values against "the mean is at most 0" and "the mean is at least 0".

        Such an e-value is the Bayes factor of `evidence` with one half of the prior, the
        positive or the negative one. Where its hypothesis is true, it ever reaches 1 / level with a
        probability of at most `level`, however long one launches; so it may be read after any
        launch, also after one that depends on other comparisons. It is 1 with too few launches.
        """
        from scipy.special import stdtr

        growth, scale = self._growth, self.leverage * self.squares
        total = growth * scale + self.mean**2
        share = np.divide(self.mean**2, total, out=np.zeros_like(total), where=total > 0)
        gain = (growth - 1) * share
        power = (self.freedom + 1) / 2
        # twice the two-sided Bayes factor, and the posterior probability of a positive mean
        factor = 2 * (1 + gain) ** power / np.sqrt(growth)
        quantile = np.sign(self.mean) * np.sqrt(2 * power * gain)
        positive, negative = (
            np.where(self.freedom > 0, factor * stdtr(self.freedom + 1, side), 1.0)
            for side in (quantile, -quantile)
        )
        return positive, negative

    @property
    def _growth(self) -> np.ndarray:
        """How many times larger the prior makes the variance of the mean."""
        return 1 + PRIOR / self.leverage


def fit(cells: np.ndarray) -> Fit:
    """Estimate the mean of launches of one or more comparisons.

    A launch is left out where it is further than DISTURBED deviations from the median of its
    residue; the deviation is estimated from the median of absolute differences. None is left out
    where those launches could be a second mode of the same noise: where they are too many (see
    `most_disturbed`), or where fewer than three more than they are remain of their residue.

    Args:
      cells: launches, of shape (comparisons, residues, launches of a residue); NaN where a residue
        has fewer. Each residue has at least one.
    """
    counts = np.sum(~np.isnan(cells), axis=2)
    disturbed = _disturbed(cells, counts)
    undisturbed = np.where(disturbed, np.nan, cells)
    counts = counts - disturbed.sum(axis=2)
    means = np.nansum(undisturbed, axis=2) / counts
    residues = cells.shape[1]
    return Fit(
        mean=means.mean(axis=1),
        leverage=(1 / counts).sum(axis=1) / residues**2,
        freedom=counts.sum(axis=1) - residues,
        squares=np.nansum((undisturbed - means[:, :, None]) ** 2, axis=(1, 2)),
        left_out=disturbed.sum(axis=(1, 2)),
    )


def _disturbed(cells: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """Return which cells `fit` leaves out; `counts` has (comparisons, residues) launches."""
    residues = cells.shape[1]
    distances = np.abs(cells - _middle(np.sort(cells, axis=2), counts)[:, :, None])
    # as many distances as there are residues say nothing: a median fits its own residue
    free = counts.sum(axis=1) - residues + 1
    ordered = np.sort(distances.reshape(len(cells), -1), axis=1)[:, residues - 1 :]
    deviation = 1.4826 * _middle(ordered, free)
    far = distances > DISTURBED * deviation[:, None, None]
    most = np.array([most_disturbed(n) for n in range(int(free.max()) + 1)])[free]
    of_residue = far.sum(axis=2)
    is_allowed = (of_residue.sum(axis=1) <= most) & np.all(
        (of_residue == 0) | (counts >= 2 * of_residue + 3), axis=1
    )
    disturbed: np.ndarray = far & is_allowed[:, None, None]
    return disturbed


def _middle(ordered: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """Return the medians of the first `counts` ordered values along the last axis."""
    ends = (counts[..., None] - 1) // 2, counts[..., None] // 2
    low, high = (np.take_along_axis(ordered, end, axis=-1)[..., 0] for end in ends)
    medians: np.ndarray = (low + high) / 2
    return medians


@functools.cache
def most_disturbed(count: int) -> int:
    """Return how many of `count` launches can be disturbed, rather than one of two equal modes.

    Of launches in two equal modes, no more than that many are in the smaller one with a
    probability of at most SECOND_MODE (the critical value of the two-sided sign test).
    """
    total, count = 0, min(count, MOST_LAUNCHES)
    for number in range(count):
        total += math.comb(count, number)
        if 2 * total / 2**count > SECOND_MODE:
            return max(number - 1, 0)
    return 0


def student_interval(
    samples: Sequence[float], confidence: float, beside: Sequence[float] = ()
) -> Interval:
    """Return the mean of launches with Student's interval.

    It holds for a number of launches that does not depend on what they say. Launches `beside` them
    have a mean of their own, but the same deviation. Where both together show a larger one, it
    counts: a few launches may agree by chance.
    """
    from scipy.special import stdtrit

    fitted = fit(cells(samples, None))
    if beside:
        other = fit(cells(beside, None))
        freedom = fitted.freedom + other.freedom
        pooled = (fitted.squares + other.squares) / np.maximum(1, freedom)
        own = fitted.squares / np.maximum(1, fitted.freedom)
        fitted = replace(fitted, freedom=freedom, squares=freedom * np.maximum(own, pooled))
    mean, freedom_of_mean = float(fitted.mean[0]), int(fitted.freedom[0])
    if freedom_of_mean <= 0:
        return Interval(mean, None, None)
    quantile = float(stdtrit(freedom_of_mean, (1 + confidence) / 2))
    return Interval.around(mean, quantile * float(fitted.deviation[0]))


def least_disturbed(samples: Sequence[float], least: int) -> Interval:
    """Return the mean of the higher half of launches beside other programs, and the range of all.

    Other programs delay paths with threads more than the plain loop, so they lower a speed-up.
    Fewer than `least` launches have no range.
    """
    ordered = sorted(samples, reverse=True)
    mean = statistics.mean(ordered[: math.ceil(len(ordered) / 2)])
    has_range = len(ordered) >= least
    return Interval(mean, ordered[-1], ordered[0]) if has_range else Interval(mean, None, None)


def evidence(
    samples: Sequence[float], confidence: float, residues: Sequence[int] | None = None
) -> Evidence:
    """Return what independent launches say of their mean, with its anytime-valid interval.

    The interval may be computed after every new launch, and launching stopped at any time: the
    probability that any of these intervals misses the mean is about 1 - confidence. It contains
    the values that a Bayes factor does not reject at 1 / (1 - confidence). Its prior is right-Haar
    on the deviation and the means of residues, and normal with variance PRIOR on the ratio of mean
    to deviation. For normal launches that factor is a test martingale, and the bound is exact
    (Pérez-Ortiz, Lardy, de Heij and Grünwald, E-statistics, group invariance and anytime-valid
    testing, Annals of Statistics 52, 2024; for linear models: Lindon, Ham, Tingley and Bojinov,
    Anytime-valid linear models, arXiv 2210.08589).

    Args:
      residues: residue of each launch's placement; None if libraries stay where they are.

    Raises:
      ValueError: no samples, a confidence not between 0 and 1, or residues of other launches.
    """
    fitted = fit(cells(samples, residues))
    positive, negative = fitted.e_values()
    interval = _interval(fitted, confidence)
    return Evidence(interval, len(samples), float(positive[0]), float(negative[0]))


def interval_beside(
    samples: Sequence[float], confidence: float, others: Sequence[float], residues: Sequence[int]
) -> Interval:
    """Return the interval of a few launches, whose deviation many others help to estimate.

    The few have a mean of their own. Their deviation is taken to be that of the others, so that
    three launches have an interval, too. `residues` are of the placements of the others.
    """
    own = fit(cells(samples, None))
    if others:
        more = fit(cells(others, residues))
        own = replace(own, freedom=own.freedom + more.freedom, squares=own.squares + more.squares)
    return _interval(own, confidence)


def e_benjamini_hochberg(e_values: Sequence[float], level: float) -> tuple[bool, ...]:
    """Return which hypotheses of a family are rejected; at most `level` of them wrongly, expected.

    The hypotheses with the k largest e-values are rejected, for the largest k for which all of
    these reach n / (k level), of n hypotheses. A single one is rejected only at n / level (Wang and
    Ramdas, False discovery rate control with e-values, Journal of the Royal Statistical Society B
    84, 2022). It is the procedure of Benjamini and Hochberg on 1 / e, which also holds for e-values
    that are read when a rule of one's own says stop, because comparisons are independent.
    """
    if not 0 < level < 1:
        raise ValueError(f"need a level in (0, 1), got {level}")
    count = len(e_values)
    ordered = sorted(e_values, reverse=True)
    least = min((e for k, e in enumerate(ordered, 1) if e >= count / (k * level)), default=math.inf)
    return tuple(e >= least for e in e_values)


def _interval(fitted: Fit, confidence: float) -> Interval:
    if not 0 < confidence < 1:
        raise ValueError(f"need a confidence in (0, 1), got {confidence}")
    return Interval.around(float(fitted.mean[0]), float(fitted.half_width(confidence)[0]))


def cells(samples: Sequence[float], residues: Sequence[int] | None) -> np.ndarray:
    if not len(samples):
        raise ValueError("need samples")
    if residues is None:
        return np.asarray(samples, dtype=float)[None, None, :]
    groups: dict[int, list[float]] = {}
    for sample, residue in zip(samples, residues, strict=True):
        groups.setdefault(residue, []).append(sample)
    cells = np.full((1, len(groups), max(map(len, groups.values()))), np.nan)
    for row, group in enumerate(groups.values()):
        cells[0, row, : len(group)] = group
    return cells
