"""What a verdict costs, and what its time limit allows.

The limit counts from when both models are loaded, or from the start where it is a share of a whole
command. Nothing is begun that would exceed it, with one exception: the first launch, where that is
brief. A model too heavy for its limit thus ends as inconclusive, before the workload is drawn, and
in a sentence that says how long a verdict takes.
"""

import math
import time
from collections.abc import Callable

from mjbench.errors import Failure, InputError, MachineError, failure_of
from mjbench.status import Status

# How often a launch lays out its memory anew. Layouts of one program differ about as much as
# programs do, and take less time.
LAYOUTS = 5
# The same where the fewest possible quads take longer than a layout's seconds.
LONG_LAYOUTS = 3
# More of them are timed while the processes of the next launch start, up to this number.
MAX_LAYOUTS = 12
# Seconds of blocks in each layout, and the smallest and largest number of quads that fill them.
# Each section of a run has one quad at least.
LAYOUT_S, MIN_QUADS, MAX_QUADS = 0.04, 2, 100
# How often a target does all its blocks to prepare a layout, about: to check states, to warm up.
_PREPARING_RUNS = 2
# Seconds of work that is done whatever the limit, so that a short limit gives an estimate, too.
BRIEF_S = 2.0
# The limit that a sentence names is longer than expected by this factor.
_MARGIN = 1.25


class OutOfTimeError(Exception):
    """The limit does not allow what a verdict needs; the message is a sentence for people."""


# What ends a measurement whose launches so far are worth keeping.
ENDING_ERRORS = (OutOfTimeError, InputError, MachineError, KeyboardInterrupt)


def ending_of(error: BaseException) -> Failure:
    """Return how a measurement ended; running out of time is no failure, but has a line."""
    if isinstance(error, OutOfTimeError):
        return Failure(Status.OK, str(error))
    if isinstance(error, KeyboardInterrupt):
        return Failure(Status.INTERRUPTED, "interrupted")
    return failure_of(error)


def quad_count(all_blocks_s: float, nsection: int = 1, layout_s: float = LAYOUT_S) -> int:
    """Return the number of quads of a layout: equally many of each section of the run.

    Args:
      all_blocks_s: seconds that both targets together take for one block of each section, untimed
        warm-ups included.
    """
    fewest = _fewest_rounds(nsection)
    most = max(fewest, MAX_QUADS // nsection)
    return nsection * min(max(round(layout_s / (2 * all_blocks_s)), fewest), most)


def _fewest_rounds(nsection: int) -> int:
    return math.ceil(MIN_QUADS / nsection)


def layout_count(all_blocks_s: float, nsection: int = 1) -> int:
    """Return the number of layouts of a launch, at least; see `quad_count` for the arguments."""
    fewest_s = 2 * _fewest_rounds(nsection) * all_blocks_s
    return LONG_LAYOUTS if fewest_s > LAYOUT_S else LAYOUTS


def launch_s(all_blocks_s: float, nsection: int = 1) -> float:
    """Return about how long the blocks of a launch take; see `quad_count` for the arguments."""
    runs = _PREPARING_RUNS + 2 * quad_count(all_blocks_s, nsection) / nsection
    return layout_count(all_blocks_s, nsection) * runs * all_blocks_s


class TimeLimit:
    """How long one verdict may take; it needs `min_launches`."""

    def __init__(
        self,
        seconds: float = math.inf,
        min_launches: int = 1,
        clock: Callable[[], float] = time.monotonic,
        purpose: str = "a verdict",
        counts_loading: bool = False,
    ):
        """Set the limit; it begins to count with `start`, or now if it counts loading."""
        self._purpose, self._seconds, self._clock = purpose, seconds, clock
        self.min_launches = min_launches
        self._begin_s = clock() if counts_loading else None

    def start(self) -> None:
        if self._begin_s is None:
            self._begin_s = self._clock()

    def spent_s(self) -> float:
        return 0.0 if self._begin_s is None else self._clock() - self._begin_s

    def check_first_launch(self, launch_s: float, preparation_s: float = 0.0) -> None:
        """Raise OutOfTimeError where the first launch would exceed the limit and is not brief."""
        needed_s = preparation_s + launch_s
        if needed_s <= BRIEF_S:
            return
        spent_s = self.spent_s()
        if spent_s + needed_s > self._seconds:
            raise OutOfTimeError(self._sentence(launch_s, spent_s + preparation_s))

    def allows_another(self, launches: int, before_s: float, can_judge: bool) -> bool:
        """Return whether another launch fits, if it takes as long as the average one.

        Args:
          before_s: what was spent before the first of them.
          can_judge: whether they are enough for a verdict.

        Raises:
          OutOfTimeError: it does not, and they are not.
        """
        spent_s = self.spent_s()
        launch_s = (spent_s - before_s) / launches
        if spent_s + launch_s <= self._seconds:
            return True
        if not can_judge:
            raise OutOfTimeError(self._sentence(launch_s, before_s))
        return False

    def _sentence(self, launch_s: float, before_s: float) -> str:
        count = self.min_launches
        enough_s = _MARGIN * (before_s + count * launch_s)
        launches = f"{count} launch{'es' if count > 1 else ''}"
        return (
            f"a launch takes about {float(f'{launch_s:.2g}'):g} s, and {self._purpose} needs at"
            f" least {launches}, {_rounded_up(enough_s)} s in all: give a longer --budget"
        )


def _rounded_up(seconds: float) -> int:
    unit: int = 10 ** max(0, len(str(int(seconds))) - 2)
    return int(math.ceil(seconds / unit) * unit)
