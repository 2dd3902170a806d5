"""Two runs of one kind side by side, the older one as the baseline.

What `compare` timed has verdicts (see `run_differences`). Of other kinds, rows of the flat table
(`rows`) that are about the same thing are held against each other, figure by figure.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from mjbench import formats
from mjbench.commands.show import kinds, rows, run_differences
from mjbench.commands.show.reports import NamedRun
from mjbench.commands.show.rows import Cell
from mjbench.commands.show.run_differences import RunDifference
from mjbench.errors import InputError
from mjbench.host import disturbance
from mjbench.host.disturbance import Disturbance
from mjbench.interval import Interval
from mjbench.results.content import Column, Conclusion, DataTable, Section, Tone
from mjbench.results.machine_identity import identify
from mjbench.results.runs import Run

# Columns that say what a row is about, beside the options of a path.
_KEYS = (
    *("model", "environment", "program", "loop", "activity", "target", "action", "settings"),
    *("path", "nbatch", "pace", "release", "old", "new", "metric"),
)
_OPTIONS = "options."
_SHOWN = formats.digits(4)


@dataclass(frozen=True)
class Pair:
    """Two runs of one kind."""

    old: NamedRun
    new: NamedRun


@dataclass(frozen=True)
class FigureDifference:
    """A figure, or a text, of which two runs have different values.

    Attributes:
      row: what it is about, such as `humanoid, python_loop`.
      figure: its column in the flat table.
      ratio: new value over old; None where they are not numbers.
      are_apart: whether the intervals of the two do not overlap; None without intervals.
    """

    row: str
    figure: str
    old: Interval | Cell
    new: Interval | Cell
    ratio: float | None = None
    are_apart: bool | None = None


def pair_of(named_runs: Sequence[NamedRun], across: bool) -> Pair | None:
    """Return two runs to compare: of one kind, and of one machine unless `across`."""
    if len(named_runs) != 2:
        return None
    old, new = sorted(named_runs, key=lambda named: named.run.header.began)
    machines = set(identify([named.run.header.machine for named in (old, new)]))
    is_one_kind = kinds.kind_of(old.run) is kinds.kind_of(new.run)
    return Pair(old, new) if is_one_kind and (across or len(machines) == 1) else None


def differences(pair: Pair, across: bool) -> Sequence[RunDifference] | Sequence[FigureDifference]:
    """Return how two runs differ; InputError where they have no row in common."""
    old, new = pair.old.run, pair.new.run
    if kinds.kind_of(new) is kinds.COMPARE:
        if not (timed := run_differences.differences(old, new, across)):
            raise InputError(f"{pair.old.file} and {pair.new.file} have no timed row in common")
        return timed
    olds, news = _by_key(old), _by_key(new)
    if not (common := [key for key in news if key in olds]):
        raise InputError(f"{pair.old.file} and {pair.new.file} have no row in common")
    return [
        _difference(key, figure, olds[key].get(figure), value)
        for key in common
        for figure, value in news[key].items()
        if olds[key].get(figure) != value
    ]


def section(pair: Pair, found: Sequence[RunDifference] | Sequence[FigureDifference]) -> Section:
    """Return what the differences of two runs come to."""
    timed = [row for row in found if isinstance(row, RunDifference)]
    figures = [row for row in found if isinstance(row, FigureDifference)]
    shown = run_differences.differences_section(timed) if timed else _section(pair, figures)
    named = {"OLD": pair.old, "NEW": pair.new}
    facts = [
        f"{side}: {each.file}, {each.run.header.began}, {each.command}"
        for side, each in named.items()
    ]
    return replace(shown, facts=facts)


def _by_key(run: Run) -> dict[str, Mapping[str, Interval | Cell]]:
    """Return the figures of each row, by what the row is about."""
    by_key: dict[str, Mapping[str, Interval | Cell]] = {}
    for row in rows.of_run(run):
        filled = {name: cell for name, cell in row.items() if cell not in (None, "")}
        key = ", ".join(str(cell) for name, cell in filled.items() if _is_key(name))
        by_key[key] = _figures({n: cell for n, cell in filled.items() if not _is_key(n)})
    return by_key


def _is_key(name: str) -> bool:
    return name in _KEYS or name.startswith(_OPTIONS)


def _figures(row: Mapping[str, Cell]) -> dict[str, Interval | Cell]:
    """Return cells by column; an estimate and its ends are one."""
    figures: dict[str, Interval | Cell] = {}
    for name, cell in row.items():
        stem, _, part = name.rpartition(".")
        if part not in ("estimate", "low", "high"):
            figures[name] = cell
        elif part == "estimate" and isinstance(cell, float):
            low, high = row.get(f"{stem}.low"), row.get(f"{stem}.high")
            figures[stem] = cell
            if isinstance(low, float) and isinstance(high, float):
                figures[stem] = Interval(cell, low, high)
    return figures


def _difference(
    key: str, figure: str, old: Interval | Cell, new: Interval | Cell
) -> FigureDifference:
    ratio = are_apart = None
    numbers = [_number(old), _number(new)]
    if numbers[0] and numbers[1] is not None:
        ratio = numbers[1] / numbers[0]
    if isinstance(old, Interval) and isinstance(new, Interval):
        are_apart = not (_reaches(old, new) and _reaches(new, old))
    return FigureDifference(key, figure, old, new, ratio, are_apart)


def _reaches(lower: Interval, upper: Interval) -> bool:
    """Return whether an interval ends where another one begins, or above it."""
    return lower.high is None or not upper.is_above(lower.high)


def _number(value: Interval | Cell) -> float | None:
    match value:
        case Interval():
            return value.estimate
        case bool() | str() | None:
            return None
    return value


def _section(pair: Pair, found: Sequence[FigureDifference]) -> Section:
    cautions = [
        Conclusion(f"{side}: {disturbance.sentence(each.clauses)}", Tone.CAUTION)
        for side, named in (("OLD", pair.old), ("NEW", pair.new))
        for each in named.run.of_type(Disturbance)
    ]
    apart = sum(bool(row.are_apart) for row in found)
    text = f"Figures that differ: {len(found)}; by more than their intervals: {apart}"
    table = DataTable.of(
        "Differences",
        found,
        (Column("of", wraps=True), lambda row: row.row),
        (Column("figure"), lambda row: row.figure),
        (Column("old", has_figures=True), lambda row: _text(row.old)),
        (Column("new", has_figures=True), lambda row: _text(row.new)),
        (Column("new / old", formats.decimals(3)), lambda row: row.ratio),
        (Column("intervals", leaves=1), lambda row: _overlap(row.are_apart)),
    )
    notes = [
        "What is the same in both is left out",
        "The two were measured at different times: the machine may account for a difference",
    ]
    return Section("NEW beside OLD", [*cautions, Conclusion(text)], tables=[table], notes=notes)


def _text(value: Interval | Cell) -> str:
    number = _number(value)
    if number is None:
        return "" if value is None else str(value)
    return formats.with_interval(value, _SHOWN) if isinstance(value, Interval) else _SHOWN(number)


def _overlap(are_apart: bool | None) -> str:
    return "" if are_apart is None else "apart" if are_apart else "overlap"
