"""Results of several machines side by side, for `show` and reports.

Verdicts of paired comparisons are decided together (see `verdicts_across`). Of runs of
`compare`, the tables have the advised path on each machine.
"""

from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from mjbench.report import advice_across, formats, verdicts, verdicts_across
from mjbench.report.advice_across import AdviceAcross
from mjbench.report.content import Column, Conclusion, DataTable, Section, Tone, filled
from mjbench.report.verdicts_across import (
    AcrossMachines,
    MachineComparison,
    MachinesOutcome,
    MachineVerdict,
)
from mjbench.store.machine_identity import MachineIdentity, identify
from mjbench.store.runs import Run

# Machines have a column each where the table is no wider than so many characters; otherwise each
# cell of the table is a row.
_MOST_WIDTH = 150
# Comparisons, and advised paths, that have a sentence each, at most; all are in the tables.
_MOST_SENTENCES = 30


@dataclass(frozen=True)
class SideBySide:
    """Results of several machines, side by side; `machines` has that of each run."""

    machines: Sequence[MachineIdentity]
    verdicts: AcrossMachines
    advice: Sequence[AdviceAcross]

    @property
    def has_several(self) -> bool:
        return len(set(self.machines)) > 1


def side_by_side(runs: Sequence[Run]) -> SideBySide:
    machines = identify([run.header.machine for run in runs])
    names = [machine.name for machine in machines]
    decided = verdicts_across.decide(verdicts_across.rows_of(runs, names))
    return SideBySide(machines, decided, advice_across.advice_across(runs, names))


def tables_by_machine(results: SideBySide) -> Iterator[DataTable]:
    """Yield verdicts by machine, and advised paths by machine, where there are any."""
    verdict_cells = {
        name: {verdict.machine: verdict_cell(verdict) for verdict in comparison.machines}
        for name, comparison in named_comparisons(results)
    }
    advice_cells = {
        across.question.name: {m.machine: advice_across.cell(m) for m in across.machines}
        for across in results.advice
    }
    yield from filled(
        by_machine("Verdicts by machine", "comparison", verdict_cells),
        by_machine("Advised paths by machine", "model", advice_cells),
    )


def by_machine(title: str, subject: str, cells: Mapping[str, Mapping[str, str]]) -> DataTable:
    """Return a table with a column for each machine, or, where that is too wide, a row a cell."""
    machines = list(dict.fromkeys(machine for row in cells.values() for machine in row))
    headings = [subject, *machines]
    rows = [[name, *(row.get(each, "–") for each in machines)] for name, row in cells.items()]
    widths = [max(map(len, column)) for column in zip(headings, *rows, strict=True)]
    if sum(widths) + len(widths) > _MOST_WIDTH:
        headings = [subject, "machine", "result"]
        rows = [[name, *pair] for name, row in cells.items() for pair in row.items()]
    return DataTable(title, [*map(Column, headings)], rows)


def section(results: SideBySide) -> Section | None:
    """Return what machines show side by side; None where nothing stands side by side."""
    tables = [*tables_by_machine(results)]
    if not tables:
        return None
    advice = [Conclusion(text) for text in advice_across.describe(results.advice)]
    return Section(
        "Across machines",
        conclusions=[*_verdicts(results), *_cut(advice, "sentences on advised paths")],
        tables=[*tables, _counts(results)],
        notes=list(notes(results)),
        is_open=True,
    )


def _verdicts(results: SideBySide) -> Iterator[Conclusion]:
    if not results.verdicts.comparisons:
        return
    yield Conclusion(verdicts.describe_all_machines(results.verdicts))
    conclusions = [
        Conclusion(verdicts.describe_machines(comparison, name), _tone(comparison))
        for name, comparison in named_comparisons(results)
    ]
    yield from _cut(conclusions, "comparisons")


def _cut(conclusions: Sequence[Conclusion], noun: str) -> Iterator[Conclusion]:
    """Yield the first conclusions, and how many are only in a table."""
    yield from conclusions[:_MOST_SENTENCES]
    rest = len(conclusions) - _MOST_SENTENCES
    if rest > 0:
        yield Conclusion(f"{rest} further {noun} are only in the tables.")


def _tone(comparison: MachineComparison) -> Tone:
    """Return what a comparison means: slower on one machine is bad, whatever the others say."""
    outcomes = {verdict.outcome for verdict in comparison.machines}
    if MachinesOutcome.SLOWER in outcomes:
        return Tone.BAD
    if outcomes == {MachinesOutcome.SAME}:
        return Tone.NEUTRAL
    return Tone.GOOD if MachinesOutcome.FASTER in outcomes else Tone.UNSURE


def _counts(results: SideBySide) -> DataTable:
    return DataTable.of(
        "On how many machines",
        [
            (name, comparison, [ratio.estimate for ratio in comparison.ratios])
            for name, comparison in named_comparisons(results)
        ],
        (Column("comparison"), lambda row: row[0]),
        (Column("machines", formats.count), lambda row: len(row[1].machines)),
        *(
            (Column(each.value, formats.count), lambda row, each=each: len(row[1].of_outcome(each)))
            for each in MachinesOutcome
        ),
        (Column("from", formats.change), lambda row: min(row[2], default=None)),
        (Column("to", formats.change), lambda row: max(row[2], default=None)),
        (Column("differ"), lambda row: formats.yes_no(row[1].differs)),
        (
            Column("changed work", formats.count),
            lambda row: sum(bool(verdict.changed_work) for verdict in row[1].machines),
        ),
    )


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
    """Return a list of runs; `names` has that of each run's machine."""
    return DataTable.of(
        "Runs",
        zip(names, runs, strict=True),
        (Column("machine"), lambda row: row[0]),
        (Column("command"), lambda row: row[1].header.typed_command),
        (Column("began"), lambda row: row[1].header.began),
        (Column("records", formats.count, leaves=1), lambda row: len(row[1].records)),
    )


def verdict_cell(verdict: MachineVerdict) -> str:
    """Return a machine's verdict, with its ratio and interval, for a cell of a table."""
    detail = f" ({verdict.detail})" if verdict.detail else ""
    outcome = f"{verdict.outcome}{detail}"
    if verdict.ratio is None:
        return outcome
    return f"{formats.with_interval(verdict.ratio, formats.change)} {outcome}"
