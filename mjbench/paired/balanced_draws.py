"""Random draws that take all items equally often."""

import random


class BalancedDraws:
    """Draws from the integers below a number, in random order, each of them equally often."""

    def __init__(self, size: int, rng: random.Random):
        """Draw nothing yet.

        Args:
          size: how many integers there are: those from 0 to `size` - 1.
          rng: decides the order.
        """
        self._size, self._rng = size, rng
        self._remaining: list[int] = []

    def draw(self, count: int) -> list[int]:
        """Return different integers; none is drawn again before all others were.

        Args:
          count: of them; `size` at most.
        """
        if len(self._remaining) < count:
            drawn = [i for i in range(self._size) if i not in self._remaining]
            last = list(self._remaining)
            self._rng.shuffle(drawn)
            self._rng.shuffle(last)
            # those that remain come first now, and last in the next round
            self._remaining += drawn + last
        result, self._remaining = self._remaining[:count], self._remaining[count:]
        return result
