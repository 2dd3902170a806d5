"""How far a measurement is: functions that are called with its progress."""

from collections.abc import Callable

# Called with what is measured now, and the share of all work that is done.
Progress = Callable[[str, float], None]


def ignore(name: str, share: float) -> None:
    """Do nothing."""


def part_of(on_progress: Progress, begin: float, end: float) -> Progress:
    """Return what shows the progress of a part of the work as that of the whole.

    Args:
      on_progress: shows that of the whole.
      begin: share of the whole that is done before the part.
      end: share that is done after it.
    """
    return lambda name, share: on_progress(name, begin + (end - begin) * share)
