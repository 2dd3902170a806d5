"""What `mjbench sweep` prints: the cells of a plan, what the nodes did, and what failed."""

from collections.abc import Mapping, Sequence

from rich.console import Console

from mjbench.report import tables
from mjbench.status import Status
from mjbench.sweep.cells import Cell
from mjbench.sweep.results import Outcome
from mjbench.sweep.run import Summary

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


def print_cells(out: Console, cells: Sequence[Cell], done: Mapping[Cell, Outcome]) -> None:
    """Print the names of all cells, how those that have a result ended, and how many there are."""
    table = tables.plain_table(["result", "status"])
    for cell in cells:
        result = done.get(cell)
        table.add_row(cell.name, "" if result is None else result.status.value)
    out.print(table)
    results = tables.count_of(len(cells), "result")
    out.print(f"\n{results}, {len(cells) - len(done)} of them missing.")


def print_summary(out: Console, summary: Summary, outcomes: Mapping[Cell, Outcome]) -> None:
    """Print what the nodes did, which cells failed, and which are missing.

    Args:
      outcomes: of all cells that have a result, earlier ones included.
    """
    _print_nodes(out, summary)
    print_failures(out, outcomes)
    if summary.missing:
        count = len(summary.missing)
        names = ", ".join(cell.name for cell in summary.missing[:_MOST_MISSING])
        rest = f" and {count - _MOST_MISSING} more" if count > _MOST_MISSING else ""
        out.print(f"Missing: {names}{rest}", soft_wrap=True)


def print_failures(out: Console, outcomes: Mapping[Cell, Outcome]) -> None:
    """Print which cells failed, and how."""
    failed = [item for item in outcomes.items() if item[1].status in _FAILED]
    for cell, outcome in failed[:_MOST_CELLS]:
        out.print(tables.headed(cell.name, f": {outcome.status}, {outcome.detail}"), soft_wrap=True)
    if len(failed) > _MOST_CELLS:
        further = tables.count_of(len(failed) - _MOST_CELLS, "further result")
        out.print(f"{further} failed.")


def _print_nodes(out: Console, summary: Summary) -> None:
    headings = ["node", "machine", "results", "measured", "was busy", "why"]
    table = tables.plain_table(headings, right=(2, 3, 4))
    for record in summary.nodes:
        table.add_row(
            record.name,
            record.label,
            str(record.cells),
            duration(record.measured_s),
            duration(record.busy_s) if record.busy_s else "",
            record.objection,
        )
    for left_out in summary.left_out:
        table.add_row(left_out.name, "", "", "", "", f"left out: {left_out.reason}")
    out.print(table)
