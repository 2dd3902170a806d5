"""Which values the keyword arguments of `mjbench.api` can have: those of the options of commands.

Each function returns the value that it was given, or raises InputError with one line that names the
argument.
"""

import operator
from collections.abc import Callable, Iterable
from enum import StrEnum
from typing import Any, Concatenate, ParamSpec, TypeVar

from mjbench.errors import InputError, wrong_argument
from mjbench.limits import COUNT, Bounds
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


def number(name: str, value: float, bounds: Bounds) -> float:
    try:
        checked = float(value)
    except (TypeError, ValueError, OverflowError):
        raise wrong_argument(name, value, "a number") from None
    if checked not in bounds:
        raise wrong_argument(name, value, str(bounds))
    return abs(checked) if checked == 0 else checked  # -0 is 0


def whole(name: str, value: Any, bounds: Bounds = COUNT, is_float: bool = False) -> int:
    """Return a whole number within bounds; `is_float`: it may be given as `1e9`."""
    try:
        if isinstance(value, bool):
            raise TypeError
        checked = int(value) if is_float and value == int(value) else operator.index(value)
    except (TypeError, ValueError, OverflowError):
        raise wrong_argument(name, value, "a whole number") from None
    if checked not in bounds:
        raise wrong_argument(name, value, str(bounds))
    return checked


def wholes(name: str, value: int | Iterable[int], bounds: Bounds = COUNT) -> list[int]:
    several = value if isinstance(value, Iterable) else (value,)
    numbers = list(dict.fromkeys(whole(name, number, bounds) for number in several))
    if not numbers:
        raise InputError(f"{name} is empty: give a number, or several")
    return numbers


def choice(name: str, value: str, choices: type[_Choice]) -> _Choice:
    try:
        return choices(value)
    except ValueError:
        raise wrong_argument(name, value, f"one of {', '.join(choices)}") from None


def holds(nstep: int | None, hold: int) -> None:
    """Refuse a number of steps that is not a multiple of hold."""
    if nstep is not None:
        workload.check_sizes(1, nstep, hold)


def names(name: str, value: str | Iterable[str]) -> list[str]:
    """Return one name or several, each once; commas separate names, as on the command line."""
    several = [value] if isinstance(value, str) else value
    if not isinstance(several, Iterable) or not all(isinstance(text, str) for text in several):
        raise wrong_argument(name, value, "a text, or several")
    split = [part.strip() for text in several for part in text.split(",")]
    unique = list(dict.fromkeys(filter(None, split)))
    if not unique:
        raise InputError(f"{name} is empty: give a name, or several")
    return unique
