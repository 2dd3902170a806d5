"""Options of commands: each is declared once, as a field of a frozen dataclass.

    @dataclass(frozen=True, kw_only=True)
    class LatencyOptions(WorkOptions, OutputOptions):
        rate_hz: float | None = option(None, HERTZ, "Paced steps per second", unset="real time")

The field gives the option of the command line with its help (`cli.shared.takes`), the keyword of
the function of `import mjbench` with its text (`api.functions.with_options`), the bounds of its
values at both entrances, and its key in the header of the run file (`stored`). Own options come
first in help, then those of base classes.

A value comes as text from the command line, or from a program; a `Kind` reads both.
"""

import operator
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, TypeVar

from mjbench import limits
from mjbench.errors import InputError, one_line, wrong_argument
from mjbench.limits import Bounds

_Parsed = TypeVar("_Parsed")
_KEY = "option"


@dataclass(frozen=True)
class Kind:
    """A kind of values.

    Attributes:
      metavar: what help calls a value.
      annotation: the type of a value in a program.
      read: returns what a text stands for, within bounds or not; raises ValueError if for nothing.
      check: returns the value of what a program gave under a name; raises InputError.
      expected: what a text is to be, for the message about another one.
      written: returns a value as text, for the default in help.
      note: the unit of a value in a program, where it is not that of texts.
      syntax: a sentence on how texts are written; empty where that is plain.
      choices: the only texts that are allowed; empty if others are.
      is_file: whether it is the name of a file.
      is_flag: whether the option has no value.
      is_repeated: whether the option may be given several times.
    """

    metavar: str
    annotation: str
    read: Callable[[str], Any] = str
    check: Callable[[str, Any], Any] = lambda name, value: value
    expected: str = ""
    written: Callable[[Any], str] = str
    note: str = ""
    syntax: str = ""
    choices: tuple[str, ...] = ()
    is_file: bool = False
    is_flag: bool = False
    is_repeated: bool = False

    def parse(self, text: str) -> Any:
        """Return the value of a text; raises ValueError if it stands for none."""
        try:
            return self.check("", self.read(text))
        except InputError as error:
            raise ValueError(str(error)) from error


@dataclass(frozen=True)
class Option:
    """An option.

    Attributes:
      name: of its field, and of the keyword of a function.
      default: the value where none is given.
      text: of the help.
      flags: its names on the command line.
      unset: what a default of None stands for.
      of_functions: whether functions have it, too.
      is_stored: whether the header of a run file has it.
    """

    name: str
    default: Any
    kind: Kind
    text: str
    flags: tuple[str, ...]
    unset: str
    of_functions: bool
    is_stored: bool

    @property
    def annotation(self) -> str:
        return f"{self.kind.annotation} | None" if self.default is None else self.kind.annotation

    def checked(self, value: Any) -> Any:
        """Return what a program gave; InputError names the option if it is out of bounds."""
        is_unset = value is None and self.default is None
        return None if is_unset else self.kind.check(self.name, value)


def option(
    default: Any,
    kind: Kind,
    text: str,
    *flags: str,
    unset: str = "",
    of_functions: bool = True,
    is_stored: bool = True,
) -> Any:
    """Return the field of an option (see `Option`); its flag follows from its name by default."""
    is_stored = is_stored and of_functions
    given = Option("", default, kind, text, flags, unset, of_functions, is_stored)
    return field(default=default, metadata={_KEY: given})


def options_of(kind: type[Any]) -> list[Option]:
    """Return the options of a dataclass: its own, then those of its base classes.

    Texts may name attributes of the dataclass, such as `{0.EACH_S}`.
    """
    by_name = {each.name: each for each in fields(kind) if _KEY in each.metadata}
    names = (name for base in kind.__mro__ for name in vars(base).get("__annotations__", ()))
    options = []
    for name in dict.fromkeys(names):
        if name in by_name:
            given = by_name[name].metadata[_KEY]
            flag = f"--{name.removesuffix('_s').removesuffix('_hz')}".replace("_", "-")
            text, unset = given.text.format(kind), given.unset.format(kind)
            flags = given.flags or (flag,)
            options.append(replace(given, name=name, flags=flags, text=text, unset=unset))
    return options


def stored(options: Any) -> dict[str, Any]:
    """Return the options that the header of a run file has; `--resume` compares them."""
    return {
        each.name: getattr(options, each.name)
        for each in options_of(type(options))
        if each.is_stored
    }


class TextError(ValueError):
    """A text stands for no value; the message says more than what was expected."""


def parsed(text: str, parse: Callable[[str], _Parsed]) -> list[_Parsed]:
    """Return what the words of a list with commas stand for.

    Raises:
      TextError: `parse` refuses one; it names that, if there are several.
    """
    values = []
    for word in text.split(","):
        try:
            values.append(parse(word))
        except (InputError, ValueError):
            raise TextError("" if word == text else one_line(repr(word), 60)) from None
    return values


def _within(
    name: str, value: Any, bounds: Bounds, expected: str, number_of: Callable[[Any], Any]
) -> Any:
    try:
        number = number_of(value)
    except (TypeError, ValueError, OverflowError):
        raise wrong_argument(name, value, expected) from None
    if number not in bounds:
        raise wrong_argument(name, value, str(bounds))
    return abs(number)  # -0 is 0


def _whole(name: str, value: Any, bounds: Bounds) -> int:
    number: int = _within(name, value, bounds, "a whole number", _index)
    return number


def _index(value: Any) -> int:
    if isinstance(value, bool):
        raise TypeError
    return operator.index(value)


def _numeric(
    metavar: str,
    bounds: Bounds,
    expected: str,
    read: Callable[[str], float],
    written: Callable[[Any], str] = str,
    note: str = "",
    syntax: str = "",
) -> Kind:
    """Return a kind of numbers within bounds."""

    def check(name: str, value: Any) -> Any:
        return _within(name, value, bounds, "a number", float)

    def read_stripped(text: str) -> float:
        return read(text.strip())

    return Kind(metavar, "float", read_stripped, check, expected, written, note, syntax)


def _read_share(text: str) -> float:
    """Return a percentage as a share; without its sign it must be 1 or more."""
    number = float(text.removesuffix("%"))
    if 0 < number < 1 and not text.endswith("%"):
        raise TextError(f"{text}% or {100 * number:g}%?")
    return number / 100


def share(below: float = 1.0) -> Kind:
    """Return the kind of percentages such as `1%` or `0.5%`, which are shares above 0."""
    return _numeric(
        "PERCENT",
        Bounds(0, below, is_open=True, is_open_above=True, hint=limits.SHARE.hint),
        f"a percentage such as 1%, above 0% and below {100 * below:g}%",
        _read_share,
        lambda value: f"{100 * value:g}%",
        "As a share: 0.01 is 1 %.",
        "PERCENT is 1% or 1; below 1 it needs the sign: 0.5%.",
    )


# By how a time ends; longer endings first.
_SECONDS_PER = {"min": 60.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "s": 1.0}


def _seconds(bounds: Bounds) -> Kind:
    def read(text: str) -> float:
        unit = next((unit for unit in _SECONDS_PER if text.endswith(unit)), "")
        return float(text.removesuffix(unit)) * _SECONDS_PER.get(unit, 1.0)

    expected = f"a time such as 60s, {bounds}"
    syntax = "SECONDS is 60 or 60s; also with ms, us or min: 5ms."
    return _numeric(
        "SECONDS", bounds, expected, read, lambda value: f"{value:g}s", "In seconds.", syntax
    )


def or_none(kind: Kind) -> Kind:
    """Return the kind that also has None, which `none` stands for on the command line."""
    return replace(
        kind,
        metavar=f"{kind.metavar}|none",
        annotation=f"{kind.annotation} | None",
        read=lambda text: None if text == "none" else kind.read(text),
        check=lambda name, value: None if value is None else kind.check(name, value),
        expected=f"{kind.expected}, or none",
    )


def _large(name: str, value: Any) -> Any:
    def number_of(value: Any) -> int:
        return int(value) if isinstance(value, float) and value.is_integer() else _index(value)

    return _within(name, value, limits.LARGE_COUNT, "a whole number", number_of)


def count(bounds: Bounds = limits.COUNT) -> Kind:
    expected = f"a whole number, {bounds}"
    return Kind("N", "int", int, lambda name, value: _whole(name, value, bounds), expected)


def numbers(bounds: Bounds = limits.COUNT) -> Kind:
    """Return the kind of whole numbers with commas, each of them once."""

    def check(name: str, value: Any) -> list[int]:
        several = value if isinstance(value, Iterable) else (value,)
        checked = list(dict.fromkeys(_whole(name, number, bounds) for number in several))
        if not checked:
            raise InputError(f"{name} is empty: give a number, or several")
        return checked

    return Kind(
        "N,N,…",
        "int | Iterable[int]",
        lambda text: parsed(text, lambda word: _whole("", int(word), bounds)),
        check,
        f"a list of whole numbers such as 1,2,4, each {bounds}",
    )


def _names(name: str, value: Any) -> list[str]:
    """Return one name or several, each once; commas separate names, as on the command line."""
    several = [value] if isinstance(value, str) else value
    if not isinstance(several, Iterable) or not all(isinstance(text, str) for text in several):
        raise wrong_argument(name, value, "a text, or several")
    split = [part.strip() for text in several for part in text.split(",")]
    if not (names := list(dict.fromkeys(filter(None, split)))):
        raise InputError(f"{name} is empty: give a name, or several")
    return names


def names_among(names: Sequence[str], metavar: str = "NAME,…") -> Kind:
    """Return the kind of one or several of these names, with commas."""

    def read(text: str) -> list[str]:
        words = [word for word in text.split(",") if word.strip()]
        if not words:
            raise ValueError
        return parsed(",".join(words), lambda word: names[names.index(word.strip())])

    expected = f"one of {', '.join(names)}, or several with commas"
    return Kind(metavar, "str", read, expected=expected)


def _settings(name: str, value: Any) -> list[str]:
    if not isinstance(value, Mapping):
        raise wrong_argument(name, value, "a dictionary")
    several = {
        key: [values] if isinstance(values, str) or not isinstance(values, Iterable) else values
        for key, values in value.items()
    }
    return [f"{key}={','.join(map(str, values))}" for key, values in several.items()]


def choice(*choices: str, metavar: str = "") -> Kind:
    def check(name: str, value: Any) -> str:
        if value not in choices:
            raise wrong_argument(name, value, f"one of {', '.join(choices)}")
        return str(value)

    return Kind(metavar, "str", check=check, choices=tuple(map(str, choices)))


SECONDS, SECONDS_OR_ZERO = _seconds(limits.SECONDS), _seconds(limits.SECONDS_OR_ZERO)
SHARE = share()
HERTZ = _numeric(
    "HZ",
    limits.HERTZ,
    f"a number of times per second such as 1000, {limits.HERTZ}",
    lambda text: float(text.removesuffix("Hz")),
)
COUNT, SEED, THREADS = count(), count(limits.SEED), numbers(limits.THREADS)
LARGE_COUNT = Kind(
    "N", "float", float, _large, f"a whole number such as 1000000 or 1e9, {limits.LARGE_COUNT}"
)
NAMES = Kind("NAME,…", "str | Iterable[str]", str, _names, "a name, or several with commas")
SETTINGS = Kind("NAME=V,V", "Mapping[str, Any]", check=_settings, is_repeated=True)
FLAG = Kind("", "bool", is_flag=True)


def text(metavar: str) -> Kind:
    return Kind(metavar, "str")


def file(metavar: str, annotation: str = "Path", note: str = "") -> Kind:
    return Kind(metavar, annotation, note=note, is_file=True)
