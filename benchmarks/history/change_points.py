"""Change points, excursions and drifts in a series of log ratios, one of each release.

The series is cut into segments, each level or with a constant slope. Of all ways to cut it, the one
with the least cost is taken, which optimal partitioning finds exactly (Jackson et al., An algorithm
for optimal partitioning of data on an interval, IEEE Signal Processing Letters 12, 2005). The cost
is the sum of squared residuals, in units of the deviation of each value, and a penalty for each
segment. `benchmarks/studies/history_simulation.py` measures which change points are
detected, and how many are wrong.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

# What a segment costs, what a slope costs besides, and what a single release does, since it may be
# an outlier. In units of squared deviations.
_SEGMENT, _SLOPE, _SINGLE = 14.0, 9.0, 8.0
# A slope has at least so many releases, and is no steeper than this from one to the next: a few
# steps in one direction are no drift.
_MIN_SLOPED, _MAX_SLOPE = 4, 0.015
# The smallest change that is listed.
MIN_CHANGE = math.log1p(0.01)
# A change point is listed where the releases on both sides fit their own side better than the other
# by as much. Otherwise it may be a release earlier or later.
_LOCATED = 6.0
# At most this share of the listed change points is wrong in simulated histories whose log ratios
# have a standard error up to the second number (benchmarks/studies/history_simulation.py).
FALSE_DISCOVERY_RATE, SIMULATED_DEVIATION = 0.05, 0.01

# A change without a test of its own counts if it is as many standard errors.
MIN_DEVIATIONS = 4.0


@dataclass(frozen=True)
class Segment:
    """Neighbouring releases, from `begin` to before `end`, of a level or a slope of log ratios."""

    begin: int
    end: int
    first: float
    last: float
    first_variance: float
    last_variance: float

    @property
    def is_sloped(self) -> bool:
        return self.first != self.last


@dataclass(frozen=True)
class ChangePoint:
    """A change from one release to the next, that at `index`."""

    before: int
    index: int
    change: float
    deviation: float


@dataclass(frozen=True)
class Excursion:
    """A single release that is off, where the next one is not: a regression, or an outlier.

    The change of the log ratio is from the mean of the segments around it. The newest release has
    no next one, so it cannot be an excursion yet.
    """

    index: int
    change: float


@dataclass(frozen=True)
class Drift:
    """Releases from `begin` to before `end` over which the log ratio changes slowly.

    The change is that of the log ratio in all, without change points in between.
    """

    begin: int
    end: int
    change: float


@dataclass(frozen=True)
class Changes:
    """What happened in a series; each list is in the order of the releases."""

    change_points: Sequence[ChangePoint]
    excursions: Sequence[Excursion]
    drifts: Sequence[Drift]


def changes(
    log_ratios: Sequence[float], deviations: Sequence[float], min_change: float = MIN_CHANGE
) -> Changes:
    """Return the changes of a series that are at least `min_change`, a log ratio."""
    parts = segments(log_ratios, deviations)
    excursions = [
        excursion
        for before, single, after in zip(parts, parts[1:], parts[2:], strict=False)
        if (excursion := _excursion(before, single, after)) and abs(excursion.change) >= min_change
    ]
    is_off = {excursion.index for excursion in excursions}
    lasting = [segment for segment in parts if segment.begin not in is_off]
    change_points = [
        point
        for before, after in itertools.pairwise(lasting)
        if abs((point := _change_point(before, after)).change) >= min_change
        and _is_located(point, before.last, after.first, log_ratios, deviations)
    ]
    drifts = [drift for drift in _drifts(parts) if abs(drift.change) >= min_change]
    return Changes(change_points, excursions, drifts)


def segments(log_ratios: Sequence[float], deviations: Sequence[float]) -> list[Segment]:
    """Return the segments of a series, in order; ValueError if a deviation is not positive."""
    values, sigma = np.asarray(log_ratios, float), np.asarray(deviations, float)
    if values.shape != sigma.shape or not np.all(sigma > 0):
        raise ValueError("need a positive deviation of each log ratio")
    weights = sigma**-2
    sums = _sums(values, weights)
    totals = np.zeros(len(values) + 1)
    last_segments: list[tuple[int, bool]] = []  # where it begins, and whether it slopes
    for end in range(1, len(values) + 1):
        level, sloped = _costs(sums, end)
        through = totals[:end] + np.minimum(level, sloped)
        begin = int(np.argmin(through))
        last_segments.append((begin, bool(sloped[begin] < level[begin])))
        totals[end] = through[begin]
    result: list[Segment] = []
    end = len(values)
    while end:
        begin, is_sloped = last_segments[end - 1]
        result.append(_fit(values, weights, begin, end, is_sloped))
        end = begin
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
    can_slope = (count >= _MIN_SLOPED) & (np.abs(product) <= _MAX_SLOPE * spread)
    gain = product**2 / np.where(can_slope, spread, 1.0)
    sloped = np.where(can_slope, residual - gain + _SEGMENT + _SLOPE, np.inf)
    return level, sloped


def _fit(values: np.ndarray, weights: np.ndarray, begin: int, end: int, is_sloped: bool) -> Segment:
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


def _drifts(parts: Sequence[Segment]) -> list[Drift]:
    """Return the drifts; neighbouring slopes in one direction are one, their changes added."""
    drifts: list[Drift] = []
    for part in parts:
        if not part.is_sloped:
            continue
        change = part.last - part.first
        if drifts and drifts[-1].end == part.begin and drifts[-1].change * change > 0:
            earlier = drifts.pop()
            drifts.append(Drift(earlier.begin, part.end, earlier.change + change))
        else:
            drifts.append(Drift(part.begin, part.end, change))
    return drifts


def _change_point(before: Segment, after: Segment) -> ChangePoint:
    deviation = math.sqrt(before.last_variance + after.first_variance)
    return ChangePoint(before.end - 1, after.begin, after.first - before.last, deviation)


def _is_located(
    point: ChangePoint,
    old: float,
    new: float,
    log_ratios: Sequence[float],
    deviations: Sequence[float],
) -> bool:
    """Return whether the releases beside a change point are clearly on their own sides of it."""
    for index, own, other in ((point.before, old, new), (point.index, new, old)):
        distances = (log_ratios[index] - other) ** 2 - (log_ratios[index] - own) ** 2
        if distances < _LOCATED * deviations[index] ** 2:
            return False
    return True


def _excursion(before: Segment, single: Segment, after: Segment) -> Excursion | None:
    change = single.first - (before.last + after.first) / 2
    returns = abs(after.first - before.last) < abs(change) / 2
    if single.end - single.begin == 1 and returns:
        return Excursion(single.begin, change)
    return None
