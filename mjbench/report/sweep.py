"""What `mjbench sweep` prints: the cells of a plan, what the nodes did, and what failed."""

from collections.abc import Mapping, Sequence

from mjbench.report import formats
from mjbench.report.content import Column, Conclusion, DataTable, Section, Tone
from mjbench.status import Status
from mjbench.sweep.cells import Cell
from mjbench.sweep.results import CellOutcome
from mjbench.sweep.run import Summary
from mjbench.units import count_of

# At most so many failed cells, and so many missing ones, are named.
_MOST_CELLS, _MOST_MISSING = 50, 3
# How failed cells ended.
_FAILED = frozenset({Status.CRASHED, Status.TIMEOUT, Status.FAILED, Status.INPUT, Status.DISAGREES})


def duration(seconds: float) -> str:
    """Return a time as people write it, such as `1 h 20 min`."""
    minutes = round(seconds / 60)
    if minutes == 0:
        return f"{seconds:.0f} s"
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes} min" if hours else f"{minutes} min"


def cells_section(cells: Sequence[Cell], done: Mapping[Cell, CellOutcome], command: str) -> Section:
    """Return what a plan asks for; `command` measures what is missing."""
    table = DataTable.of(
        "Results",
        cells,
        (Column("result"), lambda cell: cell.name),
        (Column("status"), lambda cell: done[cell].status.value if cell in done else None),
    )
    missing = len(cells) - len(done)
    end = f": {command}" if missing else ""
    return Section(
        "Results",
        [Conclusion(f"{count_of(len(cells), 'result')}, {missing} of them missing{end}")],
        tables=[table],
    )


def section(outcomes: Mapping[Cell, CellOutcome], summary: Summary | None) -> Section:
    """Return what all results come to, and what a sweep did, unless none was missing."""
    if summary is None:
        text = "The run set has all results of the plan; nothing was measured."
        return Section("Results", [Conclusion(text), *_failures(outcomes)])
    missing = []
    if summary.missing:
        count = len(summary.missing)
        names = ", ".join(cell.name for cell in summary.missing[:_MOST_MISSING])
        rest = f" and {count - _MOST_MISSING} more" if count > _MOST_MISSING else ""
        missing.append(f"Missing: {names}{rest}; the same command measures what is missing")
    numbers = f"{count_of(len(outcomes), 'result')} stored, {len(summary.missing)} missing"
    conclusions = [Conclusion(numbers), *_failures(outcomes)]
    return Section("Nodes", conclusions, tables=[_nodes_table(summary)], notes=missing)


def _failures(outcomes: Mapping[Cell, CellOutcome]) -> list[Conclusion]:
    failed = [item for item in outcomes.items() if item[1].status in _FAILED]
    conclusions = [
        Conclusion(f"{cell.name}: {outcome.status}, {outcome.detail}", Tone.BAD)
        for cell, outcome in failed[:_MOST_CELLS]
    ]
    if len(failed) > _MOST_CELLS:
        further = count_of(len(failed) - _MOST_CELLS, "further result")
        conclusions.append(Conclusion(f"{further} failed.", Tone.BAD))
    return conclusions


def _nodes_table(summary: Summary) -> DataTable:
    measured = [
        (node.name, node.label, node.cells, node.measured_s, node.busy_s or None, node.objection)
        for node in summary.nodes
    ]
    left_out = [
        (node.name, "", None, None, None, f"left out: {node.reason}") for node in summary.left_out
    ]
    times = Column("measured", duration), Column("was busy", duration)
    names = Column("node"), Column("machine"), Column("results", formats.count)
    return DataTable("Nodes", (*names, *times, Column("why")), [*measured, *left_out])
