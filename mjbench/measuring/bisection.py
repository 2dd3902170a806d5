"""Which of a row of versions is the first slower one, from noisy log ratios of some of them.

The baseline is fast, the last version is slower by a known log ratio, and one version in between is
the first slower one. Each is as likely as any other before anything is measured; then each log
ratio changes their probabilities, by the density of Student's t with few degrees of freedom, since
launches have heavy tails. What is measured next is what leaves the least entropy, as expected.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

# Degrees of freedom of a log ratio: one in 30 is further than 3 deviations from the truth.
FREEDOM = 4.0
# Levels that a version can have, of which the expectation over its log ratio is taken.
_POINTS = 61
_REACH = 6.0
# Between two levels lies what is further from both than this share of their distance, and as many
# deviations besides.
_MIDDLE, _CLEAR = 1 / 3, 1.0
# A log ratio that is expected to lower the entropy by less tells nothing.
_LEAST_GAIN = 0.005
# Versions of which it is worked out what they would tell: those nearest to the median.
_TRIED = 5
# A version that is ready is measured next if it tells at least this share of what another would.
_ENOUGH = 0.75


@dataclass(frozen=True)
class VersionRatio:
    """A log ratio of a version, numbered from 1, over the baseline."""

    version: int
    log_ratio: float


@dataclass(frozen=True)
class ChangePosterior:
    """What is known about the first slower one of `count` versions; the last one is slower.

    Attributes:
      change: log ratio of the slower versions over the others.
      deviation: of a log ratio.
    """

    count: int
    change: float
    deviation: float
    observations: Sequence[VersionRatio] = ()

    @property
    def probabilities(self) -> np.ndarray:
        """(count,) probability that version 1, 2, … is the first slower one."""
        first = np.arange(1, self.count + 1)
        logs = np.zeros(self.count)
        for each in self.observations:
            logs += _log_density(self._distances(each.log_ratio, each.version >= first))
        weights = np.exp(logs - logs.max())
        return np.asarray(weights / weights.sum())

    @property
    def likeliest(self) -> int:
        return int(np.argmax(self.probabilities)) + 1

    @property
    def certainty(self) -> float:
        return float(self.probabilities.max())

    def is_between(self, log_ratio: float) -> bool:
        """Return whether a log ratio is certainly neither of the two levels, but between them."""
        share = log_ratio / self.change
        margin = _MIDDLE + _CLEAR * self.deviation / abs(self.change)
        return margin < share < 1 - margin

    def next_version(self, unable: Collection[int] = (), ready: Collection[int] = ()) -> int | None:
        """Return the version whose log ratio tells most; None where none tells anything.

        One that is `ready`, and so costs less to measure, is preferred if it tells about as much.
        """
        probabilities = self.probabilities
        # that the version before is fast, and this one slow, is most open near the median
        shares = np.cumsum(probabilities)
        able = [version for version in range(1, self.count) if version not in unable]
        able = sorted(able, key=lambda version: abs(shares[version - 1] - 0.5))
        at_hand = [version for version in able if version in ready][:_TRIED]
        gains = {
            version: _entropy(probabilities) - self._expected_entropy(version, probabilities)
            for version in dict.fromkeys([*able[:_TRIED], *at_hand])
        }
        most = max(gains.values(), default=0.0)
        if most < _LEAST_GAIN:
            return None
        telling = [version for version in at_hand if gains[version] >= _ENOUGH * most]
        return max(telling or gains, key=lambda version: gains[version])

    def _expected_entropy(self, version: int, probabilities: np.ndarray) -> float:
        slow, fast = probabilities[:version], probabilities[version:]
        share = float(slow.sum())
        low, high = sorted((0.0, self.change))
        reach = _REACH * self.deviation
        log_ratios = np.linspace(low - reach, high + reach, _POINTS)
        densities = [
            np.exp(_log_density(self._distances(log_ratios, np.array(level))))
            for level in (False, True)
        ]
        total = (1 - share) * densities[0] + share * densities[1]
        posterior = share * densities[1] / total
        # within each of the two groups of versions, probabilities keep their ratio
        entropies = (
            posterior * _entropy(slow)
            + (1 - posterior) * _entropy(fast)
            - _log_product(posterior)
            - _log_product(1 - posterior)
        )
        return float((entropies * total).sum() / total.sum())

    def _distances(self, log_ratio: float | np.ndarray, is_slow: np.ndarray) -> np.ndarray:
        return np.asarray((log_ratio - np.where(is_slow, self.change, 0.0)) / self.deviation)


def _log_density(distance: np.ndarray) -> np.ndarray:
    """Return the logarithm of Student's density, but for a constant."""
    return np.asarray(-(FREEDOM + 1) / 2 * np.log1p(distance**2 / FREEDOM))


def _log_product(values: np.ndarray) -> np.ndarray:
    return np.asarray(values * np.log(np.where(values > 0, values, 1.0)))


def _entropy(weights: np.ndarray) -> float:
    total = float(weights.sum())
    return 0.0 if total <= 0 else -float(_log_product(weights / total).sum())
