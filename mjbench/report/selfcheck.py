"""What `mjbench selfcheck` comes to: how often verdicts on known truths are wrong."""

from collections.abc import Sequence
from typing import assert_never

from mjbench.paired.outcomes import Arm
from mjbench.paired.selfcheck_records import CaseRow, SelfcheckRow
from mjbench.report import formats
from mjbench.report.content import Cell, Column, Conclusion, DataTable, Section, Tone


def section(rows: Sequence[SelfcheckRow], confidence: float) -> Section:
    """Return what trials come to: a table of slowdowns and one of builds, each if there is any."""
    between = [row for row in rows if row.arm == Arm.BETWEEN_BUILDS]
    slowdowns = [row for row in rows if row.arm != Arm.BETWEEN_BUILDS]
    problems = dict.fromkeys(row.problem for row in rows if row.problem)
    return Section(
        "How often is a verdict wrong?",
        [_conclusion(rows, confidence)],
        tables=[
            *([_slowdown_table(slowdowns)] if slowdowns else []),
            *([_build_table(between)] if between else []),
        ],
        notes=[f"compared as shipped: {problem}" for problem in problems],
    )


def _conclusion(rows: Sequence[SelfcheckRow], confidence: float) -> Conclusion:
    wrong = sum(round(row.wrong * row.trials) for row in rows)
    count = sum(row.trials for row in rows)
    if not count:
        return Conclusion("No trial was finished.", Tone.UNSURE)
    tone = Tone.GOOD if wrong <= (1 - confidence) * count else Tone.BAD
    return Conclusion(f"{wrong} of {count} verdicts on known truths are wrong", tone)


def _slowdown_table(rows: Sequence[SelfcheckRow]) -> DataTable:
    """Return the table of trials in which both targets are the same build."""
    shares = ("called slower", "wrong", "missed", "inconclusive", "coverage")
    cells = [
        _cells(row, (row.detected, row.wrong, row.missed, row.inconclusive, row.covered))
        for row in rows
    ]
    return DataTable("Known slowdowns", _columns("slowdown", shares), cells)


def _build_table(rows: Sequence[SelfcheckRow]) -> DataTable:
    """Return the table of trials between builds that execute the same instructions."""
    shares = ("different", "by code", "only as shipped", "inconclusive", "coverage")
    cells = [
        _cells(row, (row.wrong, row.by_code, row.by_placement, row.inconclusive, row.covered))
        for row in rows
    ]
    return DataTable("Builds of the same code", _columns("old → new", shares), cells)


def _columns(case: str, shares: Sequence[str]) -> list[Column]:
    return [
        Column("model"),
        Column(case),
        Column("placement"),
        Column("trials", formats.count),
        *(Column(share, formats.percent) for share in shares),
        Column("mean error", lambda error: f"{100 * error:+.3f} %"),
        Column("seconds", formats.tenths),
        Column("launches", formats.tenths),
        Column("launch sd", lambda deviation: f"{100 * deviation:.2f} %"),
    ]


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


def _cells(row: SelfcheckRow, shares: Sequence[float | None]) -> Sequence[Cell]:
    """Return the cells of a row; the shares are what its table is about."""
    return (
        row.model,
        describe_case(row),
        "averaged" if row.averaged else "as shipped",
        row.trials,
        *shares,
        row.error,
        row.seconds,
        row.launches,
        row.launch_sd,
    )
