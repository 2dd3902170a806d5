"""Steps and drifts in a series of log ratios, one of each release.

The series is cut into segments, each level or with a constant slope. Of all ways to cut it, the one
with the least cost is taken, which optimal partitioning finds exactly (Jackson et al., An algorithm
for optimal partitioning of data on an interval, IEEE Signal Processing Letters 12, 2005). The cost
is the sum of squared residuals, in units of the deviation of each value, and a penalty for each
segment. `benchmarks/history_simulation.py` measures which steps are found, and how many wrongly.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

# What a segment costs, what a slope costs besides, and what a segment of one release does: that one
# could as well be an outlier. In units of squared deviations.
_SEGMENT, _SLOPE, _SINGLE = 14.0, 14.0, 8.0
# A slope has at least so many releases.
_MIN_SLOPED = 4
# The smallest change that is listed.
MIN_CHANGE = math.log1p(0.01)


@dataclass(frozen=True)
class Segment:
    """Neighbouring releases whose log ratios are level, or change by as much from each to the next.

    Attributes:
      begin: index of the first release.
      end: index after the last release.
      first: fitted log ratio of the first release.
      last: fitted log ratio of the last release.
      first_variance: of `first`.
      last_variance: of `last`.
    """

    begin: int
    end: int
    first: float
    last: float
    first_variance: float
    last_variance: float

    @property
    def is_sloped(self) -> bool:
        """Whether it has a slope."""
        return self.first != self.last


@dataclass(frozen=True)
class Step:
    """A change from one release to the next.

    Attributes:
      before: index of the last release before it.
      index: of the first release after it.
      change: of the log ratio.
      deviation: standard error of `change`.
    """

    before: int
    index: int
    change: float
    deviation: float


@dataclass(frozen=True)
class Excursion:
    """A single release that is off, where the next one is not: a regression, or an outlier.

    Attributes:
      index: of the release.
      change: of the log ratio, from the mean of the segments around it.
    """

    index: int
    change: float


@dataclass(frozen=True)
class Drift:
    """Releases over which the log ratio changes slowly.

    Attributes:
      begin: index of the first release.
      end: index after the last release.
      change: of the log ratio in all.
    """

    begin: int
    end: int
    change: float


@dataclass(frozen=True)
class Changes:
    """What happened in a series; each list is in the order of the releases."""

    steps: Sequence[Step]
    excursions: Sequence[Excursion]
    drifts: Sequence[Drift]


def changes(
    log_ratios: Sequence[float], deviations: Sequence[float], min_change: float = MIN_CHANGE
) -> Changes:
    """Return the steps, the excursions and the drifts of a series.

    Args:
      log_ratios: (n,) one of each release, in order.
      deviations: (n,) standard error of each.
      min_change: the smallest change that is returned, as a log ratio.

    Raises:
      ValueError: there are not as many of the one as of the other, or a deviation is not positive.
    """
    found = segments(log_ratios, deviations)
    excursions = [
        excursion
        for before, single, after in zip(found, found[1:], found[2:], strict=False)
        if (excursion := _excursion(before, single, after)) and abs(excursion.change) >= min_change
    ]
    is_off = {excursion.index for excursion in excursions}
    lasting = [segment for segment in found if segment.begin not in is_off]
    steps = [
        step
        for before, after in itertools.pairwise(lasting)
        if abs((step := _step(before, after)).change) >= min_change
    ]
    drifts = [
        Drift(s.begin, s.end, s.last - s.first)
        for s in found
        if s.is_sloped and abs(s.last - s.first) >= min_change
    ]
    return Changes(steps, excursions, drifts)


def segments(log_ratios: Sequence[float], deviations: Sequence[float]) -> list[Segment]:
    """Return the segments of a series, in order; see `changes` for arguments and errors."""
    values, sigma = np.asarray(log_ratios, float), np.asarray(deviations, float)
    if values.shape != sigma.shape or not np.all(sigma > 0):
        raise ValueError("need a positive deviation of each log ratio")
    weights = sigma**-2
    sums = _sums(values, weights)
    totals, last_segments = np.zeros(1), []
    for end in range(1, len(values) + 1):
        level, sloped = _costs(sums, end)
        through = totals + np.minimum(level, sloped)
        begin = int(np.argmin(through))
        is_sloped = bool(sloped[begin] < level[begin])
        last_segments.append(_fit(values, weights, begin, end, is_sloped))
        totals = np.append(totals, through[begin])
    result: list[Segment] = []
    end = len(values)
    while end:
        result.append(last_segments[end - 1])
        end = result[-1].begin
    return result[::-1]


def _sums(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return (6, n + 1) running sums of w, wx, wxx, wy, wxy and wyy."""
    x = np.arange(len(values), dtype=float)
    terms = np.array([np.ones_like(x), x, x * x, values, x * values, values * values])
    return np.concatenate([np.zeros((6, 1)), np.cumsum(weights * terms, axis=1)], axis=1)


def _costs(sums: np.ndarray, end: int) -> tuple[np.ndarray, np.ndarray]:
    """Return (end,) costs of the segments that begin at each release and end before `end`.

    The first are those of level segments, the second those of sloped ones.
    """
    w, wx, wxx, wy, wxy, wyy = sums[:, end, None] - sums[:, :end]
    count = end - np.arange(end)
    residual = wyy - wy**2 / w
    level = residual + _SEGMENT + np.where(count == 1, _SINGLE, 0.0)
    spread, product = wxx - wx**2 / w, wxy - wx * wy / w
    can_slope = count >= _MIN_SLOPED
    gain = product**2 / np.where(can_slope, spread, 1.0)
    sloped = np.where(can_slope, residual - gain + _SEGMENT + _SLOPE, np.inf)
    return level, sloped


def _fit(values: np.ndarray, weights: np.ndarray, begin: int, end: int, is_sloped: bool) -> Segment:
    """Return the best fit of a segment."""
    y, w = values[begin:end], weights[begin:end]
    total = float(w.sum())
    mean = float((w * y).sum()) / total
    if not is_sloped:
        return Segment(begin, end, mean, mean, 1 / total, 1 / total)
    x = np.arange(end - begin, dtype=float)
    x -= (w * x).sum() / total
    spread = float((w * x**2).sum())
    slope = float((w * x * y).sum()) / spread
    ends = [(mean + slope * float(x[i]), 1 / total + float(x[i]) ** 2 / spread) for i in (0, -1)]
    (first, first_variance), (last, last_variance) = ends
    return Segment(begin, end, first, last, first_variance, last_variance)


def _step(before: Segment, after: Segment) -> Step:
    deviation = math.sqrt(before.last_variance + after.first_variance)
    return Step(before.end - 1, after.begin, after.first - before.last, deviation)


def _excursion(before: Segment, single: Segment, after: Segment) -> Excursion | None:
    """Return the excursion that one release is, if the next one is nearer to the one before."""
    change = single.first - (before.last + after.first) / 2
    returns = abs(after.first - before.last) < abs(change) / 2
    if single.end - single.begin == 1 and returns:
        return Excursion(single.begin, change)
    return None
