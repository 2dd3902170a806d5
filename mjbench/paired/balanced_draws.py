"""Random draws that take all items equally often."""

import random


class BalancedDraws:
    """Draws integers below a number in random order, each equally often to within one."""

    def __init__(self, size: int, rng: random.Random):
        """Draw nothing yet.

        Args:
          size: how many integers there are: those from 0 to `size` - 1.
          rng: decides the order.
        """
        self._rng = rng
        self._counts = [0] * size

    def draw(self, count: int) -> list[int]:
        """Return different integers: those that were drawn least often, ties in random order.

        Args:
          count: of them; `size` at most.
        """
        drawn = sorted(
            range(len(self._counts)), key=lambda i: (self._counts[i], self._rng.random())
        )
        for i in drawn[:count]:
            self._counts[i] += 1
        return drawn[:count]
