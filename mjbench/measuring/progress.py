"""How far a measurement is: functions that are called with its progress."""

from collections.abc import Callable

# Called with what is measured now, and the share of all work that is done.
Progress = Callable[[str, float], None]


def ignore(name: str, share: float) -> None:
    """Do nothing."""
