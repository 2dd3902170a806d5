"""What a paired comparison compares, and how it ends.

It imports nothing heavy, because `mjbench --help` imports it.
"""

from enum import StrEnum

# What a verdict is asked for unless the user says otherwise: the smallest change that matters, the
# confidence of its interval, the half-width at which to stop, and the seconds that it may take.
MIN_EFFECT, CONFIDENCE, PRECISION, TIME_LIMIT_S = 0.01, 0.99, 0.005, 60.0


class Verdict(StrEnum):
    """The outcome of a paired comparison."""

    FASTER = "faster"
    """The candidate takes less time."""
    SLOWER = "slower"
    """The candidate takes more time."""
    SAME = "same"
    """Any difference is smaller than the smallest effect that matters."""
    INCONCLUSIVE = "inconclusive"
    """The launches do not decide."""


class Cause(StrEnum):
    """Why the times of two builds differ."""

    CODE = "code"
    """Their machine code: the difference remains when the placement of code is averaged out."""
    PLACEMENT = "placement"
    """Where their code lies in memory: the difference is there only as shipped."""
    WORK = "work"
    """They do different work, such as more contacts."""
    UNDECIDED = "undecided"
    """The measurements do not tell."""


class ResultsOutcome(StrEnum):
    """How what a function returned in two revisions compares."""

    SAME = "same"
    """Bit by bit."""
    ROUNDING = "rounding"
    """The differences are those of another order of additions."""
    DIFFERENT = "different"
    """They differ by more: the revisions do different work."""
    RANDOM = "random"
    """They differ from process to process of one revision, so they say nothing."""
    NONE = "none"
    """The function returns nothing, or something that cannot be compared."""
