"""The part of a report that says what several machines show side by side."""

from collections.abc import Iterator, Sequence

from mjbench.pages.content import Cell, Column, Conclusion, DataTable, Section, Tone
from mjbench.paired.across_machines import MachineComparison, Outcome
from mjbench.report import across_machines as across
from mjbench.report import advice_across, verdicts
from mjbench.report.across_machines import Matrix, SideBySide

# Comparisons, and advised paths, that have a sentence each, at most; all are in the tables.
_MOST_SENTENCES = 30


def section(results: SideBySide, command: str) -> Section | None:
    """Return what machines show side by side; None where nothing stands side by side."""
    matrices = [_table(matrix) for matrix in across.matrices(results)]
    if not matrices:
        return None
    return Section(
        "Across machines",
        command,
        conclusions=[*_verdicts(results), *_advice(results)],
        tables=[*matrices, *_counts(results)],
        notes=list(across.notes(results)),
        is_open=True,
    )


def _table(matrix: Matrix) -> DataTable:
    is_wide = len(matrix.machines) <= across.MOST_COLUMNS
    headings, rows = matrix.wide() if is_wide else matrix.long()
    return DataTable(matrix.title, [*map(Column, headings)], rows)


def _verdicts(results: SideBySide) -> Iterator[Conclusion]:
    """Yield what all verdicts come to together, then the comparisons with a change."""
    if not results.verdicts.comparisons:
        return
    yield Conclusion(verdicts.describe_all_machines(results.verdicts))
    conclusions = [
        Conclusion(verdicts.describe_machines(comparison, name), _tone(comparison))
        for name, comparison in across.named_comparisons(results)
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
    comparisons = across.named_comparisons(results)
    if not comparisons:
        return
    columns = (
        Column("comparison"),
        Column("machines", 3),
        *(Column(outcome.value, 3) for outcome in Outcome),
        Column("from, %", 3),
        Column("to, %", 3),
        Column("differ"),
        Column("changed work", 3),
    )
    rows = [(name, *_count_cells(comparison)) for name, comparison in comparisons]
    yield DataTable("On how many machines", columns, rows)


def _count_cells(comparison: MachineComparison) -> Iterator[Cell]:
    changes = [100 * (ratio.estimate - 1) for ratio in comparison.ratios]
    yield len(comparison.machines)
    yield from (len(comparison.of_outcome(outcome)) for outcome in Outcome)
    yield min(changes, default=None)
    yield max(changes, default=None)
    yield "yes" if comparison.differs else "no"
    yield sum(bool(verdict.changed_work) for verdict in comparison.machines)
