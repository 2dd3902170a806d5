"""How numbers, times, intervals and names are written for people."""

import csv
import io
from collections.abc import Callable, Iterable, Sequence
from decimal import Decimal
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # it loads msgspec, which a timer in a program needs not
    from mjbench.interval import Interval

# Writes a cell that is not a text.
Form = Callable[[Any], str]
# The longest bar, in characters.
_BAR_WIDTH = 30
# What the formulas of spreadsheets begin with, in narrow and in wide letters.
_FORMULA = tuple("=+-@\t\r\n＝＋－＠")
# What a cell of CSV can hold.
_CsvCell = str | float | int | bool | None


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


def digits(count: int) -> Form:
    """Return the form of numbers with some significant digits, and commas from 1,000 on."""

    def form(value: float) -> str:
        return f"{value:,.0f}" if abs(value) >= 1000 else plain(value, count)

    return form


def count(value: float) -> str:
    return f"{value:,.0f}"


def decimals(count: int) -> Form:
    return lambda value: f"{value:.{count}f}"


tenths = decimals(1)


def factor(ratio: float) -> str:
    """Return a speed-up in the digits that mean something."""
    return f"{ratio:.2f}" if ratio >= 0.1 else plain(ratio, 1)


def percent(share: float) -> str:
    """Return a share in percent, to a tenth."""
    return f"{100 * share:.1f} %"


def whole_percent(share: float) -> str:
    return f"{100 * share:.0f} %"


def short_percent(share: float) -> str:
    """Return a share in percent, to two significant digits."""
    return f"{plain(100 * share, 2)} %"


def change(ratio: float) -> str:
    """Return the change that a ratio stands for, in percent, with its sign."""
    return f"{100 * (ratio - 1):+.2f} %"


def change_to_tenth(ratio: float) -> str:
    """Return the change that a ratio stands for as `change` does, to a tenth of a percent."""
    return f"{100 * (ratio - 1):+.1f} %"


# What the numbers are that a form writes as percent, for programs that read them as they are.
RAW_UNITS: dict[Form, str] = {
    **dict.fromkeys((percent, whole_percent, short_percent), "share"),
    **dict.fromkeys((change, change_to_tenth), "ratio"),
}


def ends(interval: "Interval | None", form: Form = factor) -> str:
    """Return the ends of an interval, such as `1.82–2.05` or `+0.8 to +1.6 %`.

    It is empty where one of them is not known.
    """
    if interval is None or interval.low is None or interval.high is None:
        return ""
    low, high = form(interval.low), form(interval.high)
    between = " to " if low[0] in "+-" else "–"
    return f"{low.removesuffix(' %')}{between}{high}"


def in_brackets(interval: "Interval", form: Form = factor) -> str:
    """Return an interval as it follows an estimate in a sentence; empty where it is not known."""
    text = ends(interval, form)
    return f" ({text})" if text else ""


def with_interval(ratio: "Interval", form: Form = factor) -> str:
    """Return a ratio as a cell has it, such as `+1.2 % (+0.8 to +1.6 %)`."""
    return f"{form(ratio.estimate)}{in_brackets(ratio, form)}"


def as_fast(speedup: "Interval") -> str:
    """Return a speed-up as a sentence has it, such as `1.93 × as fast (1.82–2.05)`."""
    return f"{factor(speedup.estimate)} × as fast{in_brackets(speedup)}"


def ends_in(form: Form) -> Form:
    return lambda interval: ends(interval, form)


def bar(share: float) -> str:
    return "█" * round(_BAR_WIDTH * share)


def yes_no(value: bool) -> str:
    return "yes" if value else "no"


def short_names(names: Iterable[str]) -> dict[str, str]:
    """Return a short name for each: of a file, its own name where no other file has the same."""
    full = list(dict.fromkeys(names))
    own = [name.rpartition("/")[2] for name in full]
    return {
        name: short if own.count(short) == 1 else name
        for name, short in zip(full, own, strict=True)
    }


def all_machines(number: int) -> str:
    return "both machines" if number == 2 else f"all {number} machines"


def csv_text(table: Iterable[Iterable[_CsvCell]]) -> str:
    """Return rows as CSV (RFC 4180)."""
    text = io.StringIO()
    csv.writer(text).writerows(map(_cell, row) for row in table)
    return text.getvalue()


def _cell(cell: _CsvCell) -> _CsvCell:
    """Return a cell of CSV that no spreadsheet takes for a formula: such a text begins with `'`."""
    if not isinstance(cell, str) or not cell.startswith(_FORMULA):
        return cell
    try:
        float(cell)
    except ValueError:
        return f"'{cell}"
    return cell
