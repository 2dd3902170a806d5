"""How numbers and times are written for people."""

from collections.abc import Sequence
from decimal import Decimal


def plain(value: float, digits: int) -> str:
    """Return a number as people write it, such as `150` or `0.000012`, never as `1.5e+02`.

    Args:
      digits: significant digits; those before the point are always written.
    """
    if abs(value) >= 10**digits:
        return f"{value:.0f}"
    return f"{Decimal(f'{value:.{digits}g}'):f}"


def duration(ns: float) -> str:
    """Return a time in nanoseconds in the unit that suits it, such as `1.51 µs`."""
    for unit, size in (("s", 1e9), ("ms", 1e6), ("µs", 1e3)):
        if abs(ns) >= size:
            return f"{plain(ns / size, 3)} {unit}"
    return f"{ns:.0f} ns"


def mebibytes(size_bytes: int) -> str:
    return f"{size_bytes / 2**20:,.0f} MiB"


def count_of(number: int, noun: str) -> str:
    """Return a number of things, such as `1 run` or `3 runs`."""
    return f"{number:,} {noun}" if number == 1 else f"{number:,} {noun}s"


def listed(names: Sequence[str]) -> str:
    """Return `a`, `a and b`, or `a, b and c`."""
    return " and ".join([", ".join(names[:-1]), names[-1]]) if len(names) > 1 else names[0]


def short_commit(commit: str) -> str:
    """Return the first letters of a commit's hash."""
    return commit[:10]
