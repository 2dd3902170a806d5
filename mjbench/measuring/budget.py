"""The time that a command may take, and how it is divided among the things that it measures."""

import time
from collections.abc import Callable
from dataclasses import dataclass

from mjbench.measuring.timing import Clock

# Seconds in which Python starts, and in which a command prints what it measured.
AROUND_S = 1.8
# Seconds of a thing for which no time is left: it does the least that it can.
LEAST_S = 0.1


@dataclass(frozen=True)
class Budget:
    """The time of a command.

    Attributes:
      each_s: for each thing that it measures, where the user gives no time.
      total_s: of the whole command, if the user gives one.
      thing: what is measured, such as `model`.
      spent_s: of the whole, before anything is measured and after all is.
    """

    each_s: float
    total_s: float | None = None
    thing: str = "model"
    spent_s: float = AROUND_S

    @property
    def whole_s(self) -> float:
        """The seconds for the only thing of a command."""
        return (self.each_s if self.total_s is None else self.total_s) - self.spent_s

    def divided(
        self,
        count: int,
        announce: Callable[[str], None] = lambda text: None,
        clock: Clock = time.monotonic,
        begin_s: float | None = None,
    ) -> "Shares":
        """Divide the time among things; announce the share of each, if there are several.

        Args:
          begin_s: when the command began, by the clock; None for now.
        """
        if self.total_s is not None and count > 1:
            each_s = self.total_s / count
            announce(f"{self.total_s:g}s for {count} {self.thing}s: {each_s:.2g}s each")
        return Shares(self, count, clock, clock() if begin_s is None else begin_s)


class Shares:
    """The shares of the things of one command, which are measured one after the other."""

    def __init__(self, budget: Budget, count: int, clock: Clock, begin_s: float):
        self._budget, self._left, self._clock = budget, count, clock
        self._end_s = begin_s + (budget.total_s or 0.0) - budget.spent_s

    def next_s(self, effort: int = 1) -> float:
        """Return the seconds for the next thing; what one leaves is for all that follow.

        Args:
          effort: how many shares it is worth.
        """
        if self._budget.total_s is None:
            return effort * self._budget.each_s
        left_s, count = self._end_s - self._clock(), max(1, self._left)
        self._left -= 1
        return max(LEAST_S, left_s * min(1.0, effort / count))
