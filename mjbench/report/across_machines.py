"""Results of several machines side by side, for `show` and reports.

Verdicts of paired comparisons are decided together (see `paired.across_machines`). Of runs of
`compare`, the tables have the advised path on each machine.
"""

import shlex
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from mjbench.paired import across_machines
from mjbench.paired.across_machines import (
    AcrossMachines,
    MachineComparison,
    MachineVerdict,
    Outcome,
)
from mjbench.report import advice_across, formats, verdicts
from mjbench.report.advice_across import AdviceAcross
from mjbench.report.content import Cell, Column, Conclusion, DataTable, Section, Tone
from mjbench.store.machine_identity import MachineIdentity, identify
from mjbench.store.runs import Run

# Machines have a column each where the table is no wider than so many characters; otherwise each
# cell of the table is a row.
_MOST_WIDTH = 150
# Comparisons, and advised paths, that have a sentence each, at most; all are in the tables.
_MOST_SENTENCES = 30


@dataclass(frozen=True)
class SideBySide:
    """Results of several machines, side by side.

    Attributes:
      machines: of each run, in the order of the runs.
      verdicts: of paired comparisons.
      advice: of runs of `compare`.
    """

    machines: Sequence[MachineIdentity]
    verdicts: AcrossMachines
    advice: Sequence[AdviceAcross]

    @property
    def has_several(self) -> bool:
        """Whether the runs are of more than one machine."""
        return len(set(self.machines)) > 1


@dataclass(frozen=True)
class Matrix:
    """A table of results by machine.

    Attributes:
      subject: heading of the first column.
      machines: their names.
      rows: what was measured, and a cell for each machine that measured it.
    """

    title: str
    subject: str
    machines: Sequence[str]
    rows: Sequence[tuple[str, Mapping[str, str]]]

    def table(self) -> DataTable:
        """Return it with a column for each machine, or, where that is too wide, a row a cell."""
        headings = [self.subject, *self.machines]
        rows = [
            [name, *(cells.get(machine, "–") for machine in self.machines)]
            for name, cells in self.rows
        ]
        widths = [max(map(len, column)) for column in zip(headings, *rows, strict=True)]
        if sum(widths) + len(widths) > _MOST_WIDTH:
            headings = [self.subject, "machine", "result"]
            rows = [
                [name, machine, cell]
                for name, cells in self.rows
                for machine, cell in cells.items()
            ]
        return DataTable(self.title, [*map(Column, headings)], rows)


def side_by_side(runs: Sequence[Run]) -> SideBySide:
    """Return the results of runs, side by side."""
    machines = identify([run.header.machine for run in runs])
    names = [machine.name for machine in machines]
    decided = across_machines.decide(across_machines.rows_of(runs, names))
    return SideBySide(machines, decided, advice_across.advice_across(runs, names))


def matrices(results: SideBySide) -> Iterator[Matrix]:
    """Yield verdicts by machine, and advised paths by machine, where there are any."""
    if comparisons := named_comparisons(results):
        rows = [
            (name, {verdict.machine: verdict_cell(verdict) for verdict in comparison.machines})
            for name, comparison in comparisons
        ]
        yield _matrix("Verdicts by machine", "comparison", rows)
    if results.advice:
        rows = [
            (across.question.name, {m.machine: advice_across.cell(m) for m in across.machines})
            for across in results.advice
        ]
        yield _matrix("Advised paths by machine", "model", rows)


def _matrix(title: str, subject: str, rows: Sequence[tuple[str, Mapping[str, str]]]) -> Matrix:
    machines = list(dict.fromkeys(machine for _, cells in rows for machine in cells))
    return Matrix(title, subject, machines, rows)


def section(results: SideBySide) -> Section | None:
    """Return what machines show side by side; None where nothing stands side by side."""
    tables = [matrix.table() for matrix in matrices(results)]
    if not tables:
        return None
    return Section(
        "Across machines",
        conclusions=[*_verdicts(results), *_advice(results)],
        tables=[*tables, *_counts(results)],
        notes=list(notes(results)),
        is_open=True,
    )


def _verdicts(results: SideBySide) -> Iterator[Conclusion]:
    """Yield what all verdicts come to together, then the comparisons with a change."""
    if not results.verdicts.comparisons:
        return
    yield Conclusion(verdicts.describe_all_machines(results.verdicts))
    conclusions = [
        Conclusion(verdicts.describe_machines(comparison, name), _tone(comparison))
        for name, comparison in named_comparisons(results)
    ]
    yield from _cut(conclusions, "comparisons")


def _advice(results: SideBySide) -> Iterator[Conclusion]:
    conclusions = [Conclusion(text) for text in advice_across.describe(results.advice)]
    yield from _cut(conclusions, "sentences on advised paths")


def _cut(conclusions: Sequence[Conclusion], noun: str) -> Iterator[Conclusion]:
    """Yield the first conclusions, and how many are only in a table."""
    yield from conclusions[:_MOST_SENTENCES]
    rest = len(conclusions) - _MOST_SENTENCES
    if rest > 0:
        yield Conclusion(f"{rest} further {noun} are only in the tables.")


def _tone(comparison: MachineComparison) -> Tone:
    """Return what a comparison means: slower on one machine is bad, whatever the others say."""
    outcomes = {verdict.outcome for verdict in comparison.machines}
    if Outcome.SLOWER in outcomes:
        return Tone.BAD
    if outcomes == {Outcome.SAME}:
        return Tone.NEUTRAL
    return Tone.GOOD if Outcome.FASTER in outcomes else Tone.UNSURE


def _counts(results: SideBySide) -> Iterator[DataTable]:
    """Yield a table of comparisons: on how many machines they came out as what."""
    comparisons = named_comparisons(results)
    if not comparisons:
        return
    columns = (
        Column("comparison"),
        Column("machines", formats.count),
        *(Column(outcome.value, formats.count) for outcome in Outcome),
        Column("from", formats.change),
        Column("to", formats.change),
        Column("differ"),
        Column("changed work", formats.count),
    )
    rows = [(name, *_count_cells(comparison)) for name, comparison in comparisons]
    yield DataTable("On how many machines", columns, rows)


def _count_cells(comparison: MachineComparison) -> Iterator[Cell]:
    changes = [ratio.estimate for ratio in comparison.ratios]
    yield len(comparison.machines)
    yield from (len(comparison.of_outcome(outcome)) for outcome in Outcome)
    yield min(changes, default=None)
    yield max(changes, default=None)
    yield formats.yes_no(comparison.differs)
    yield sum(bool(verdict.changed_work) for verdict in comparison.machines)


def named_comparisons(results: SideBySide) -> list[tuple[str, MachineComparison]]:
    """Return comparisons with their names, those with a change first."""
    comparisons = results.verdicts.comparisons
    named = zip(comparison_names(comparisons), comparisons, strict=True)
    return sorted(named, key=lambda pair: not pair[1].names_change)


def notes(results: SideBySide) -> Iterator[str]:
    """Yield which results are not compared because machines did different work, and what to do."""
    machines: dict[str, list[set[str]]] = defaultdict(list)
    for comparison in results.verdicts.comparisons:
        names = {verdict.machine for verdict in comparison.machines}
        machines[verdicts.comparison_name(comparison)].append(names)
    for across in results.advice:
        name = f"{across.question.model}, {across.question.loop} loop"
        machines[name].append({machine.machine for machine in across.machines})
    apart = [
        name
        for name, of_sizes in machines.items()
        if len(of_sizes) > 1 and sum(map(len, of_sizes)) == len(set.union(*of_sizes))
    ]
    if apart:
        yield (
            f"Not compared, because machines did different work: {'; '.join(apart)}. Give the same"
            " --nbatch, --nstep, --settle and files on all machines."
        )


def comparison_names(comparisons: Sequence[MachineComparison]) -> list[str]:
    """Return a name for each, with its size where others have the same name."""
    names = [verdicts.comparison_name(comparison) for comparison in comparisons]
    counts = Counter(names)
    return [
        f"{name}, {c.nbatch:,} × {c.nstep:,} steps"
        if counts[name] > 1 and c.nbatch is not None and c.nstep is not None
        else name
        for name, c in zip(names, comparisons, strict=True)
    ]


def runs_table(runs: Sequence[Run], names: Sequence[str]) -> DataTable:
    """Return a list of runs.

    Args:
      runs: of any command.
      names: the name of each run's machine.
    """
    columns = (
        Column("machine"),
        Column("command"),
        Column("began"),
        Column("records", formats.count),
    )
    rows = [
        (
            name,
            shlex.join(run.header.command_line or (run.header.command,)),
            run.header.began,
            len(run.records),
        )
        for run, name in zip(runs, names, strict=True)
    ]
    return DataTable("Runs", columns, rows)


def verdict_cell(verdict: MachineVerdict) -> str:
    """Return a machine's verdict, with its ratio and interval, for a cell of a table."""
    detail = f" ({verdict.detail})" if verdict.detail else ""
    outcome = f"{verdict.outcome}{detail}"
    ratio = verdict.ratio
    if ratio is None:
        return outcome
    interval = formats.in_brackets(ratio, formats.change)
    return f"{formats.change(ratio.estimate)}{interval} {outcome}"
