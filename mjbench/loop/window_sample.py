"""Sample a bounded number of windows, spread evenly over a run of unknown length.

The run is divided into strata of `stride` steps. A stratum has at most one window, which begins at
a random step of it: windows at fixed distances would always meet the same part of an episode. When
there are too many, neighbouring strata become one, which keeps one of its two windows, at random,
and the stride doubles. So at any time windows lie everywhere in the run with equal density.
"""

import random
from typing import Generic, TypeVar

Window = TypeVar("Window")


class WindowSample(Generic[Window]):
    """A sample of the windows of one run.

    Attributes:
      stride: steps of a stratum.
      due: step of the run at which the next window is to begin.
    """

    def __init__(self, most: int, nstep: int, rng: random.Random):
        """Prepare a sample.

        Args:
          most: the most windows of the sample, at least 1.
          nstep: steps of a window.
          rng: draws where windows begin, and which stay in the sample.
        """
        self._most, self._nstep, self._rng = most, nstep, rng
        self._by_stratum: dict[int, Window] = {}
        self.stride = nstep
        self.due = 0

    def add(self, window: Window, end: int) -> None:
        """Take the window that was due, and decide when the next is.

        Args:
          window: to keep.
          end: step of the run at which it ended.
        """
        self._by_stratum[self.due // self.stride] = window
        while len(self._by_stratum) > self._most:
            self._halve()
        self.due = self._next_due(self.due // self.stride, end)

    def windows(self) -> list[Window]:
        """Return the sample, in the order of the run."""
        return [self._by_stratum[stratum] for stratum in sorted(self._by_stratum)]

    def _halve(self) -> None:
        """Make each two neighbouring strata one."""
        self.stride *= 2
        merged: dict[int, Window] = {}
        for stratum in sorted(self._by_stratum):
            if stratum // 2 not in merged or self._rng.random() < 0.5:
                merged[stratum // 2] = self._by_stratum[stratum]
        self._by_stratum = merged

    def _next_due(self, last_stratum: int, end: int) -> int:
        """Return where the next window is to begin, in a stratum that has none."""
        stratum = max(last_stratum + 1, end // self.stride)
        while True:
            room = self.stride - self._nstep
            due = stratum * self.stride + self._rng.randint(0, room)
            if due >= end:
                return due
            stratum += 1
