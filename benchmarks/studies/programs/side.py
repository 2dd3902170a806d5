"""Which side of a comparison the program is on: observed, or left alone.

`benchmarks.studies.observing` changes it while the program runs. The program counts its steps on
each side.
"""

import mmap
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco

# What the file holds, in a byte. In transit, neither side counts.
ALONE, OBSERVED, IN_TRANSIT, ENDED = range(4)


class Side:
    """The side that the program is on, as the other program wrote it into a file."""

    def __init__(self, file: Path) -> None:
        with file.open("r+b") as stream:
            self._byte = mmap.mmap(stream.fileno(), 1)

    @property
    def now(self) -> int:
        """The side at this moment."""
        return self._byte[0]

    @property
    def step(self) -> Callable[..., Any]:
        """`mujoco.mj_step` as the program has it; the engine's own where the program is alone."""
        step = mujoco.mj_step
        return step if self.now == OBSERVED else getattr(step, "__wrapped__", step)

    def change(self, side: int) -> None:
        """Change the side, for all programs that have opened the file."""
        self._byte[0] = side

    def run(self, block: Callable[[], int]) -> None:
        """Run a block again and again; print side, seconds and steps of each stretch on a side.

        The last line is the seconds of all blocks.

        Args:
          block: what to run; it returns how many steps it took.
        """
        first_s = begin_s = time.perf_counter()
        side, nstep = self.now, 0
        while side != ENDED:
            taken = block()
            if self.now == side:
                nstep += taken
                end_s = time.perf_counter()
                continue
            if nstep and side != IN_TRANSIT:
                print(side, end_s - begin_s, nstep)
            begin_s, side, nstep = time.perf_counter(), self.now, 0
        print(time.perf_counter() - first_s)
