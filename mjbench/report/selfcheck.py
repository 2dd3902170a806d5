"""What `mjbench doctor --verdicts` comes to: how often verdicts on known truths are wrong."""

from collections.abc import Callable, Sequence
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
    return _table(
        "Known slowdowns",
        "slowdown",
        rows,
        (Column("called slower", formats.percent), lambda row: row.detected),
        (Column("wrong", formats.percent), lambda row: row.wrong),
        (Column("missed", formats.percent), lambda row: row.missed),
    )


def _build_table(rows: Sequence[SelfcheckRow]) -> DataTable:
    """Return the table of trials between builds that execute the same instructions."""
    return _table(
        "Builds of the same code",
        "old → new",
        rows,
        (Column("different", formats.percent), lambda row: row.wrong),
        (Column("by code", formats.percent), lambda row: row.by_code),
        (Column("only as shipped", formats.percent, leaves=8), lambda row: row.by_placement),
    )


def _table(
    title: str,
    case: str,
    rows: Sequence[SelfcheckRow],
    *shares: tuple[Column, Callable[[SelfcheckRow], Cell]],
) -> DataTable:
    """Return a table of trials; `case` heads what differs, `shares` are what it is about."""
    return DataTable.of(
        title,
        rows,
        (Column("model"), lambda row: row.model),
        (Column(case), describe_case),
        (Column("placement", leaves=6), lambda row: "averaged" if row.averaged else "as shipped"),
        (Column("trials", formats.count), lambda row: row.trials),
        *shares,
        (Column("inconclusive", formats.percent, leaves=7), lambda row: row.inconclusive),
        (Column("coverage", formats.percent, leaves=5), lambda row: row.covered),
        (
            Column("mean error", lambda error: f"{100 * error:+.3f} %", leaves=3),
            lambda row: row.error,
        ),
        (Column("seconds", formats.tenths, leaves=4), lambda row: row.seconds),
        (Column("launches", formats.tenths, leaves=2), lambda row: row.launches),
        (Column("launch sd", lambda sd: f"{100 * sd:.2f} %", leaves=1), lambda row: row.launch_sd),
    )


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
