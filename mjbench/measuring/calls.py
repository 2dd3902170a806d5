"""How many calls of a function last as long as a block, and blocks of them.

It needs the standard library alone, because it also runs in the process of a revision.
"""

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass

from mjbench.bounds import NonNegativeFloat, NonNegativeInt

Function = Callable[[], object]

# Seconds of a block, at least. Where a core has other work, Linux lets a process run for some
# milliseconds at a time: most pairs of blocks that are much shorter are undisturbed.
BLOCK_S = 0.0002
# How often the calls of a block are timed to count them, unless they take longer than any pause.
_TRIALS, _LONG_S = 5, 0.1
# Calls of a block, at most: a call that takes no time must not make the calibration endless.
MOST_CALLS = 1_000_000


@dataclass(frozen=True)
class Compilation:
    """What a process took before steps that are compiled ran at their usual speed.

    Attributes:
      trace_s: seconds from Python to the compiler's input; None without such a stage.
      first_run_s: of the program's first run, which is compiled by then.
      programs: how many the compiler was asked for, those of single operations included; None where
        it does not tell.
      is_cached: whether the compiler found all of them in its cache.
    """

    trace_s: NonNegativeFloat | None
    compile_s: NonNegativeFloat
    first_run_s: NonNegativeFloat
    programs: NonNegativeInt | None = None
    is_cached: bool = False

    @property
    def seconds(self) -> float:
        """Of tracing and compiling."""
        return (self.trace_s or 0.0) + self.compile_s


@dataclass(frozen=True)
class PreparedCall:
    """A function whose every call needs a preparation, which is not timed.

    Attributes:
      timed: is called once after each preparation, and waits for what it began.
      result: returns what the call came to; MachineError where that is wrong.
      compilation: of what the last call ran; None where nothing is compiled.
    """

    prepare: Callable[[], None]
    timed: Callable[[], None]
    result: Function
    compilation: Callable[[], Compilation] | None = None

    def __call__(self) -> object:
        self.prepare()
        self.timed()
        return self.result()


def nothing() -> None:
    """Do nothing."""


def repeat(function: Function, calls: int) -> None:
    for _ in itertools.repeat(None, calls):
        function()


def calls_per_block(block_s: Callable[[int], float]) -> int:
    """Return how many calls of a function last as long as a block, by the shortest of some times.

    A pause of the process must not pass for a call that takes long.
    """
    calls = 1
    while calls < MOST_CALLS:
        seconds = math.inf
        for _ in range(_TRIALS):
            seconds = min(seconds, block_s(calls))
            if not BLOCK_S <= seconds < _LONG_S:
                break
        if seconds >= BLOCK_S:
            break
        growth = min(10.0, BLOCK_S / seconds) if seconds > 0 else 10.0
        calls = min(MOST_CALLS, max(calls + 1, math.ceil(calls * growth)))
    return calls
