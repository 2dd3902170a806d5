"""What a paired comparison compares, and how it ends.

It imports nothing heavy, because `mjbench --help` imports it.
"""

from enum import StrEnum


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


class Metric(StrEnum):
    """What a comparison compares."""

    TIME = "time"
    INSTRUCTIONS = "instructions"
