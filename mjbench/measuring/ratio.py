"""A ratio with its interval or its deviation: types that records, tables and advice share."""

import math
from dataclasses import dataclass

from mjbench.bounds import PositiveFloat


@dataclass(frozen=True)
class Ratio:
    """An estimate, and the ends of its interval; an end is None where it has no bound."""

    estimate: PositiveFloat
    low: PositiveFloat | None
    high: PositiveFloat | None

    @classmethod
    def of_log(cls, estimate: float, half_width: float) -> "Ratio":
        if not math.isfinite(half_width):
            return cls(math.exp(estimate), None, None)
        ends = math.exp(estimate - half_width), math.exp(estimate + half_width)
        return cls(math.exp(estimate), *ends)

    @property
    def inverse(self) -> "Ratio":
        """The ratio the other way round: of speeds, where this one is of times."""
        low, high = (None if end is None else 1 / end for end in (self.high, self.low))
        return Ratio(1 / self.estimate, low, high)

    def covers(self, value: float) -> bool:
        return (self.low is None or self.low <= value) and (self.high is None or value <= self.high)

    def is_above(self, value: float) -> bool:
        return self.low is not None and self.low > value


@dataclass(frozen=True)
class LogEstimate:
    """The time of a step or an operation in a release over that in the reference."""

    log_ratio: float
    deviation: float

    @property
    def ratio(self) -> float:
        return math.exp(self.log_ratio)
