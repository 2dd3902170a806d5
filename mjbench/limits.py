"""Which numbers a user can give to an option or to an argument, and the usual time limit."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Bounds:
    """Which numbers are allowed.

    Attributes:
      is_open: whether `least` itself is too small.
      is_open_above: whether `most` itself is too large.
      hint: the end of a message, such as an example.
    """

    least: float
    most: float
    is_open: bool = False
    is_open_above: bool = False
    hint: str = ""

    def __contains__(self, number: float) -> bool:
        is_above = number > self.least or (number == self.least and not self.is_open)
        return is_above and (number < self.most or (number == self.most and not self.is_open_above))

    def __str__(self) -> str:
        least = f"{'above' if self.is_open else 'at least'} {self.least}"
        most = f"{'below' if self.is_open_above else 'at most'} {self.most}"
        return f"{least} and {most}{self.hint}"


# Threads or worker processes: more than cores can use, and about as many as a system lets one user
# start.
MAX_THREADS = 1024
THREADS = Bounds(1, MAX_THREADS)
# Anything else that is counted, such as steps: MuJoCo counts in 32 bits.
MAX_COUNT = 2**31 - 1
COUNT = Bounds(1, MAX_COUNT)
# JSON documents hold integers of 64 bits.
SEED = Bounds(0, 2**63 - 1)
# Steps that somebody may take in all.
LARGE_COUNT = Bounds(1, 10**15)
# The highest rate of paced steps.
HERTZ = Bounds(0, 1_000_000, is_open=True)
# How often the stacks of a program can be read.
SAMPLES_PER_S = Bounds(1, 1000)
# How many days an installed release can have been unused.
DAYS = Bounds(0, 36_500)
# The longest time that can be given: what waits for a process counts milliseconds in 32 bits, and a
# compiler may take several times its limit.
MAX_SECONDS = 86_400
_DAY = ", a day in seconds"
SECONDS = Bounds(0, MAX_SECONDS, is_open=True, hint=_DAY)
SECONDS_OR_ZERO = Bounds(0, MAX_SECONDS, hint=_DAY)
SHARE = Bounds(0, 1, is_open=True, is_open_above=True, hint=", such as 0.01 for 1 %")
# A child process that is silent for longer, in seconds, is killed.
TIME_LIMIT_S = 60.0
