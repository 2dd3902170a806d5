"""Which values the keyword arguments of `mjbench.api` can have: those of the options of commands.

Each function returns the value that it was given, or raises InputError with one line that names the
argument.
"""

import math
import operator
from collections.abc import Callable, Iterable, Sequence
from enum import StrEnum
from typing import Any, Concatenate, ParamSpec, TypeVar

from mjbench.errors import InputError, one_line
from mjbench.limits import MAX_COUNT, MAX_SECONDS, MAX_SEED
from mjbench.simulation import workload

_Choice = TypeVar("_Choice", bound=StrEnum)
_Checked = TypeVar("_Checked")
_Limits = ParamSpec("_Limits")


def optional(
    check: Callable[Concatenate[str, Any, _Limits], _Checked],
    name: str,
    value: Any,
    *limits: _Limits.args,
    **options: _Limits.kwargs,
) -> _Checked | None:
    """Return None for None, and what another function of this module returns for a value."""
    return None if value is None else check(name, value, *limits, **options)


def seconds(name: str, value: float, zero: bool = False) -> float:
    """Return a time of at most a day: above 0, or also 0 where `zero`."""
    number = _number(name, value)
    if not (0 < number <= MAX_SECONDS or (zero and number == 0)):
        least = "at least 0" if zero else "above 0"
        raise _wrong(name, value, f"{least} and at most {MAX_SECONDS:.0f}, a day in seconds")
    return abs(number)  # -0 is 0


def share(name: str, value: float) -> float:
    """Return a share between 0 and 1, such as 0.01 for 1 %."""
    number = _number(name, value)
    if not 0 < number < 1:
        raise _wrong(name, value, "between 0 and 1, such as 0.01 for 1 %")
    return number


def rate_hz(name: str, value: float, most: float) -> float:
    """Return a number of times per second, above 0 and at most `most`."""
    number = _number(name, value)
    if not 0 < number <= most:
        raise _wrong(name, value, f"above 0 and at most {most:,.0f}")
    return number


def count(name: str, value: int, most: int = MAX_COUNT) -> int:
    """Return a whole number from 1 to `most`."""
    number = _whole(name, value)
    if not 1 <= number <= most:
        raise _wrong(name, value, f"at least 1 and at most {most}")
    return number


def seed(name: str, value: int) -> int:
    """Return a whole number from 0 to MAX_SEED."""
    number = _whole(name, value)
    if not 0 <= number <= MAX_SEED:
        raise _wrong(name, value, f"at least 0 and at most {MAX_SEED}")
    return number


def counts(name: str, value: int | Iterable[int], most: int = MAX_COUNT) -> list[int]:
    """Return one whole number or several, each once."""
    several = value if isinstance(value, Iterable) else (value,)
    numbers = list(dict.fromkeys(count(name, number, most) for number in several))
    if not numbers:
        raise InputError(f"{name} is empty: give a number, or several")
    return numbers


def large_count(name: str, value: float, most: int) -> int:
    """Return a whole number from 1 to `most`, which may be given as `1e9`."""
    number = _number(name, value)
    if not math.isfinite(number) or number != int(number):
        raise _wrong(name, value, "a whole number")
    return count(name, int(value), most)


def choice(name: str, value: str, choices: type[_Choice]) -> _Choice:
    """Return the member of an enumeration that a text names."""
    try:
        return choices(value)
    except ValueError:
        raise _wrong(name, value, f"one of {', '.join(choices)}") from None


def holds(nstep: int | None, hold: int) -> None:
    """Refuse a number of steps that is not a multiple of hold."""
    if nstep is not None:
        workload.check_sizes(1, nstep, hold)


def names(name: str, value: str | Iterable[str]) -> list[str]:
    """Return one name or several, each once; commas separate names, as on the command line."""
    several: Sequence[Any] = [value] if isinstance(value, str) else list(value)
    if not all(isinstance(text, str) for text in several):
        raise _wrong(name, value, "a text, or several")
    split = [part.strip() for text in several for part in text.split(",")]
    unique = list(dict.fromkeys(filter(None, split)))
    if not unique:
        raise InputError(f"{name} is empty: give a name, or several")
    return unique


def _number(name: str, value: Any) -> float:
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError):
        raise _wrong(name, value, "a number") from None


def _whole(name: str, value: Any) -> int:
    if isinstance(value, bool):
        raise _wrong(name, value, "a whole number")
    try:
        return operator.index(value)
    except TypeError:
        raise _wrong(name, value, "a whole number") from None


def _wrong(name: str, value: object, expected: str) -> InputError:
    return InputError(f"{name} must be {expected}, not {one_line(repr(value), 60)}")
