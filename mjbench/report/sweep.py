"""What `mjbench sweep` prints: the cells of a plan, what the nodes did, and what failed."""

from collections.abc import Mapping, Sequence

from rich.console import Console

from mjbench.report import tables
from mjbench.status import Status
from mjbench.sweep.cells import Cell
from mjbench.sweep.estimate import PartEstimate
from mjbench.sweep.results import Outcome
from mjbench.sweep.run import Progress, Summary

# At most so many failed cells are named, and so many assignments in the line of progress.
_MOST_CELLS, _MOST_RUNNING = 50, 3
# How failed cells ended.
_FAILED = frozenset({Status.CRASHED, Status.TIMEOUT, Status.FAILED, Status.INPUT, Status.DISAGREES})


def print_estimates(out: Console, parts: Sequence[PartEstimate]) -> None:
    """Print how many cells there are, how many have a result, and how long the others take."""
    table = tables.plain_table(["", "results", "done", "missing", "time"], right=(1, 2, 3))
    for part in parts:
        table.add_row(
            part.kind if part.metric is None else f"{part.kind}, {part.metric}",
            str(part.cells),
            str(part.done),
            str(part.cells - part.done),
            _time(part),
        )
    out.print(table)


def _time(part: PartEstimate) -> str:
    if part.missing_s is None:
        return "unknown until one is measured"
    if part.missing_s == 0:
        return ""
    amount = "at most" if part.is_limit else "about"
    return f"{amount} {duration(part.missing_s)} on one machine"


def duration(seconds: float) -> str:
    """Return a time as people write it, such as `1 h 20 min`."""
    minutes = round(seconds / 60)
    if minutes == 0:
        return f"{seconds:.0f} s"
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes} min" if hours else f"{minutes} min"


def print_cells(out: Console, cells: Sequence[Cell], done: Mapping[Cell, Outcome]) -> None:
    """Print the names of all cells, and how those that have a result ended."""
    table = tables.plain_table(["result", "status"])
    for cell in cells:
        result = done.get(cell)
        table.add_row(cell.name, "" if result is None else result.status.value)
    out.print(table)


def describe_progress(progress: Progress) -> str:
    """Return what nodes measure now, in one line."""
    parts = [
        f"{assignment.node.name}: {assignment.cells[0].name}"
        for assignment in progress.running[:_MOST_RUNNING]
    ]
    further = len(progress.running) - _MOST_RUNNING
    if further > 0:
        parts.append(f"{further} more")
    return f"{progress.done} of {progress.count} results; {', '.join(parts) or 'waiting for nodes'}"


def print_summary(out: Console, summary: Summary, outcomes: Mapping[Cell, Outcome]) -> None:
    """Print what the nodes did, which cells failed, and which are missing.

    Args:
      outcomes: of all cells that have a result, earlier ones included.
    """
    _print_nodes(out, summary)
    print_failures(out, outcomes)
    if summary.missing:
        count = len(summary.missing)
        names = ", ".join(cell.name for cell in summary.missing[:_MOST_RUNNING])
        rest = f" and {count - _MOST_RUNNING} more" if count > _MOST_RUNNING else ""
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
    headings = ["node", "machine", "results", "busy", "refused", "failed", "why"]
    table = tables.plain_table(headings, right=(2, 3, 4, 5))
    for record in summary.nodes:
        table.add_row(
            record.node.name,
            record.node.label,
            str(record.cells),
            duration(record.busy_s),
            str(record.refused or ""),
            str(record.failed or ""),
            record.reason,
        )
    for left_out in summary.left_out:
        table.add_row(left_out.name, "", "", "", "", "", f"left out: {left_out.reason}")
    out.print(table)
