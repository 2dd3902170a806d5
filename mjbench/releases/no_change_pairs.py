"""Pairs of releases whose steps execute equally many instructions.

A verdict between two of them must be `same`: they are the negative controls for whatever claims to
tell a change of code from a change of its placement in memory.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class NoChangePair:
    """Two releases, one uploaded after the other, whose steps execute the same instructions."""

    old: str
    new: str


# The releases of each pair execute equally many instructions per step on every shipped model, as
# counted by `mjbench instructions`. Their libraries differ nevertheless: code lies elsewhere, and
# instructions hold other displacements where a struct grew. In the last pair five functions that
# the cloth executes use other registers, too (`mjbench explain 3.3.1 3.3.2 cloth`).
NO_CHANGE_PAIRS = (
    NoChangePair("3.1.2", "3.1.3"),
    NoChangePair("3.2.0", "3.2.1"),
    NoChangePair("3.2.1", "3.2.2"),
    NoChangePair("3.3.1", "3.3.2"),
)
