"""An estimate with its interval: a type that records, tables and advice share."""

import math
from dataclasses import dataclass

from mjbench.bounds import PositiveFloat


@dataclass(frozen=True)
class Interval:
    """An estimate, and the ends of its interval; an end is None where it has no bound.

    Run files hold those of ratios, and refuse any that is not positive.
    """

    estimate: PositiveFloat
    low: PositiveFloat | None
    high: PositiveFloat | None

    @classmethod
    def around(cls, estimate: float, half_width: float) -> "Interval":
        """Return an interval with equal halves; its ends are None where they are infinite."""
        if not math.isfinite(half_width):
            return cls(estimate, None, None)
        return cls(estimate, estimate - half_width, estimate + half_width)

    @property
    def half_width(self) -> float:
        if self.low is None or self.high is None:
            return math.inf
        return (self.high - self.low) / 2

    @property
    def exponential(self) -> "Interval":
        """The interval of a ratio, where this one is of its natural logarithm."""
        low, high = (None if end is None else math.exp(end) for end in (self.low, self.high))
        return Interval(math.exp(self.estimate), low, high)

    @property
    def inverse(self) -> "Interval":
        """The ratio the other way round: of speeds, where this one is of times."""
        return Interval(1.0, 1.0, 1.0).over(self)

    def over(self, other: "Interval") -> "Interval":
        """Return a ratio over another; its interval holds the truth if both of theirs do."""
        low, high = (
            None if end is None or divisor is None else end / divisor
            for end, divisor in ((self.low, other.high), (self.high, other.low))
        )
        return Interval(self.estimate / other.estimate, low, high)

    def covers(self, value: float) -> bool:
        return not (self.is_above(value) or self.is_below(value))

    def is_above(self, value: float) -> bool:
        return self.low is not None and self.low > value

    def is_below(self, value: float) -> bool:
        return self.high is not None and self.high < value
