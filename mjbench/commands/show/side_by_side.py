"""Two runs of one kind side by side, the older one as the baseline.

What `compare` timed has verdicts (see `run_differences`). Of other kinds, rows of the flat table
(`rows`) that are about the same thing are held against each other, figure by figure.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from mjbench import formats
from mjbench.commands.show import kinds, rows, run_differences
from mjbench.commands.show.reports import NamedRun
from mjbench.commands.show.rows import Cell
from mjbench.commands.show.run_differences import RunDifference
from mjbench.commands.show.stored_runs import subjects
from mjbench.errors import InputError
from mjbench.host import disturbance
from mjbench.host.disturbance import Disturbance
from mjbench.results.content import Column, Conclusion, DataTable, Section, Tone
from mjbench.results.machine_identity import MachineIdentity, changed_speed, identify
from mjbench.results.runs import Run

# Columns that say what a row is about, beside the options of a path.
_KEYS = (
    *("model", "environment", "program", "loop", "activity", "target", "action", "settings"),
    *("path", "nbatch", "pace", "release", "old", "new", "metric"),
)
_ALONE = ", such as of one model: `mjbench show RUN` shows each alone"
_SHOWN = formats.digits(4)


@dataclass(frozen=True)
class FigureDifference:
    """A figure, or a text, of which two runs have different values.

    Attributes:
      row: what it is about, such as `humanoid, python_loop`.
      figure: its column in the flat table.
      ratio: new value over old; None where they are not numbers.
    """

    row: str
    figure: str
    old: Cell
    new: Cell
    ratio: float | None


Differences = Sequence[RunDifference] | Sequence[FigureDifference]


def pair_of(named_runs: Sequence[NamedRun], across: bool) -> Sequence[NamedRun]:
    """Return two runs to compare, the older first; none where they are not.

    They are of one kind, and, unless `across`, of one machine and about one thing, such as a
    model.
    """
    if not _are_two_of_one_kind(named_runs):
        return []
    old, new = sorted(named_runs, key=lambda named: named.run.header.began)
    are_of_one_machine = len(set(_machines(named_runs))) == 1
    are_about_one = not {*subjects(old.run)}.isdisjoint(subjects(new.run))
    return [old, new] if across or (are_of_one_machine and are_about_one) else []


def of_two_machines(named_runs: Sequence[NamedRun]) -> str:
    """Return that two runs without verdicts of their own are of two machines; else empty."""
    machines = _machines(named_runs)
    is_of_verdicts = bool(named_runs) and kinds.kind_of(named_runs[0].run) is kinds.VERDICT
    if not _are_two_of_one_kind(named_runs) or is_of_verdicts or len(set(machines)) == 1:
        return ""
    return (
        f"Measured on two machines ({' / '.join(each.name for each in machines)}): no verdict about"
        " the code. `mjbench ab` and `mjbench versions` measure both sides on one machine; --across"
        " compares these runs"
    )


def of_two_subjects(named_runs: Sequence[NamedRun]) -> str:
    """Return why two runs are not held against each other: they are about different things."""
    if len(named_runs) != 2:
        return ""
    old, new = ([f"`{named.run.header.command}`"] for named in named_runs)
    way_out = ""
    if _are_two_of_one_kind(named_runs):
        old, new = (subjects(named.run) for named in named_runs)
        way_out = "; --across compares them"
    if not (old and new) or not {*old}.isdisjoint(new):
        return ""
    sides = f"one run is of {formats.listed(old)}, the other of {formats.listed(new)}"
    return f"Not compared: {sides}{way_out}"


def _are_two_of_one_kind(named_runs: Sequence[NamedRun]) -> bool:
    return len(named_runs) == 2 and len({kinds.kind_of(named.run) for named in named_runs}) == 1


def _machines(named_runs: Sequence[NamedRun]) -> Sequence[MachineIdentity]:
    return identify([named.run.header.machine for named in named_runs])


def differences(old: Run, new: Run, across: bool) -> Differences:
    """Return how two runs differ; InputError where they have no row in common."""
    if kinds.kind_of(new) is kinds.COMPARE:
        if timed := run_differences.differences(old, new, across):
            return timed
        raise InputError(f"these runs have no timed row in common{_ALONE}")
    olds, news = _by_key(old), _by_key(new)
    if not olds.keys() & news.keys():
        raise InputError(f"these runs have no row in common{_ALONE}")
    return [
        FigureDifference(
            key, figure, olds[key].get(figure), value, _ratio(olds[key].get(figure), value)
        )
        for key, figures in news.items()
        for figure, value in figures.items()
        if key in olds and olds[key].get(figure) != value
    ]


def section(pair: Sequence[NamedRun], rows_that_differ: Differences) -> Section:
    """Return what the differences of two runs come to."""
    timed = [row for row in rows_that_differ if isinstance(row, RunDifference)]
    figures = [row for row in rows_that_differ if isinstance(row, FigureDifference)]
    shown = run_differences.differences_section(timed) if timed else _section(pair, figures)
    facts = [
        f"{side}: {each.file}, {each.run.header.began}, {each.command}"
        for side, each in zip(("OLD", "NEW"), pair, strict=True)
    ]
    return replace(shown, facts=facts)


def _by_key(run: Run) -> dict[str, dict[str, Cell]]:
    """Return the figures of each row, by what the row is about."""
    by_key: dict[str, dict[str, Cell]] = {}
    for row in rows.of_run(run):
        filled: dict[str, Cell] = {
            name: cell for name, cell in row.items() if cell not in (None, "")
        }
        named = [name for name in filled if name in _KEYS or name.startswith("options.")]
        key = ", ".join(str(filled.pop(name)) for name in named)
        by_key[key] = filled
    return by_key


def _ratio(old: Cell, new: Cell) -> float | None:
    if isinstance(old, str | bool | None) or isinstance(new, str | bool | None) or not old:
        return None
    return new / old


def _section(pair: Sequence[NamedRun], figures: Sequence[FigureDifference]) -> Section:
    cautions = [
        Conclusion(f"{side}: {disturbance.sentence(each.clauses)}", Tone.CAUTION)
        for side, named in zip(("OLD", "NEW"), pair, strict=True)
        for each in named.run.of_type(Disturbance)
    ]
    if speed := changed_speed(*(named.run.header.machine for named in pair)):
        cautions.append(Conclusion(speed, Tone.CAUTION))
    table = DataTable.of(
        "Differences",
        figures,
        (Column("of", wraps=True), lambda row: row.row),
        (Column("figure"), lambda row: row.figure),
        (Column("old", has_figures=True), lambda row: _text(row.old)),
        (Column("new", has_figures=True), lambda row: _text(row.new)),
        (Column("new / old", formats.decimals(3)), lambda row: row.ratio),
    )
    notes = [
        "What is the same in both is left out",
        "The two were measured at different times: the machine may account for a difference",
    ]
    count = formats.count_of(len(figures), "figure")
    conclusion = Conclusion(f"The two differ in {count}")
    return Section("NEW beside OLD", [*cautions, conclusion], tables=[table], notes=notes)


def _text(value: Cell) -> str:
    return str(value or "") if isinstance(value, str | bool | None) else _SHOWN(value)
