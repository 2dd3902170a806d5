"""The tables of `mjbench selfcheck`."""

from collections.abc import Sequence
from typing import assert_never

from rich.console import Console
from rich.table import Table

from mjbench.paired.outcomes import Arm
from mjbench.paired.selfcheck_records import CaseRow, SelfcheckRow
from mjbench.report import tables


def print_tables(out: Console, rows: Sequence[SelfcheckRow]) -> None:
    """Print a table of slowdowns and one of builds, each if there is any."""
    between = [row for row in rows if row.arm == Arm.BETWEEN_BUILDS]
    slowdowns = [row for row in rows if row.arm != Arm.BETWEEN_BUILDS]
    if slowdowns or not between:
        out.print(slowdown_table(slowdowns))
    if between:
        out.print(build_table(between))
    for problem in dict.fromkeys(row.problem for row in rows if row.problem):
        out.print(f"compared as shipped: {problem}", soft_wrap=True)


def slowdown_table(rows: Sequence[SelfcheckRow]) -> Table:
    """Return the table of trials in which both targets are the same build."""
    headings = ["model", "slowdown", "placement", "trials", "called slower", "wrong", "missed"]
    headings += ["inconclusive", "coverage", "mean error", "seconds", "launches", "launch sd"]
    table = tables.plain_table(headings, right=range(3, len(headings)))
    for row in rows:
        shares = (row.detected, row.wrong, row.missed, row.inconclusive, row.covered)
        table.add_row(*_cells(row, shares))
    return table


def build_table(rows: Sequence[SelfcheckRow]) -> Table:
    """Return the table of trials between builds that execute the same instructions."""
    headings = ["model", "old → new", "placement", "trials", "different", "by code"]
    headings += ["only as shipped", "inconclusive", "coverage", "mean error", "seconds"]
    headings += ["launches", "launch sd"]
    table = tables.plain_table(headings, right=range(3, len(headings)))
    for row in rows:
        shares = (row.wrong, row.by_code, row.by_placement, row.inconclusive, row.covered)
        table.add_row(*_cells(row, shares))
    return table


def describe_case(case: CaseRow) -> str:
    """Return how the two targets of a trial differ, such as `1 %` or `3.2.1 → 3.2.2`."""
    match case.arm:
        case Arm.SLOWDOWN:
            return f"{100 * (case.slowdown or 0.0):g} %"
        case Arm.INSIDE_STEP:
            return f"calls {case.callback}"
        case Arm.BETWEEN_BUILDS:
            return f"{case.old} → {case.new}"
    assert_never(case.arm)


def _cells(row: SelfcheckRow, shares: Sequence[float | None]) -> list[str]:
    """Return the cells of a row; the shares are what its table is about."""
    return [
        row.model,
        describe_case(row),
        "averaged" if row.averaged else "as shipped",
        str(row.trials),
        *map(_percent, shares),
        "" if row.error is None else f"{100 * row.error:+.3f} %",
        f"{row.seconds:.1f}",
        f"{row.launches:.1f}",
        "" if row.launch_sd is None else f"{100 * row.launch_sd:.2f} %",
    ]


def _percent(share: float | None) -> str:
    return "" if share is None else f"{100 * share:.1f} %"
