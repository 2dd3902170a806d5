"""An estimate with its interval: the one type that tables, documents and advice share."""

import math
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Interval:
    """An estimate, and the ends of its interval; an end is None where it has no bound."""

    estimate: float
    low: float | None = None
    high: float | None = None

    @classmethod
    def of_log(cls, estimate: float, half_width: float) -> "Interval":
        """Return the interval of a ratio from that of its natural logarithm."""
        if not math.isfinite(half_width):
            return cls(math.exp(estimate))
        ends = math.exp(estimate - half_width), math.exp(estimate + half_width)
        return cls(math.exp(estimate), *ends)

    @property
    def is_bounded(self) -> bool:
        """Whether it has both ends."""
        return self.low is not None and self.high is not None

    def inverse(self) -> "Interval":
        """Return the interval of the reciprocal; all values must be positive."""
        low = None if self.high is None else 1 / self.high
        high = None if self.low is None else 1 / self.low
        return Interval(1 / self.estimate, low, high)

    def covers(self, value: float) -> bool:
        """Return whether a value lies within; a missing end is no bound."""
        return (self.low is None or self.low <= value) and (self.high is None or value <= self.high)

    def is_above(self, value: float) -> bool:
        """Return whether the whole interval is above a value; never without a lower end."""
        return self.low is not None and self.low > value

    def text(self, of_number: Callable[[float], str]) -> str:
        """Return it for people, such as `2.03 (1.94 to 2.12)`, each number by `of_number`."""
        if self.low is None or self.high is None:
            return of_number(self.estimate)
        return f"{of_number(self.estimate)} ({of_number(self.low)} to {of_number(self.high)})"
