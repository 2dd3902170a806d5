"""What trials come to: how often verdicts on known truths are wrong."""

from collections.abc import Callable, Iterator, Sequence
from typing import assert_never

from benchmarks.verdicts.records import Arm, CaseRow, CaseSummary
from mjbench import formats
from mjbench.paired.outcomes import MIN_EFFECT
from mjbench.results.content import Cell, Column, Conclusion, DataTable, Section, Tone

# From this share of trials on, undecided ones are too many.
_MANY = 0.2


def section(
    rows: Sequence[CaseSummary], confidence: float, min_effect: float = MIN_EFFECT
) -> Section:
    """Return what trials come to: a table of slowdowns and one of builds, each if there is any."""
    between = [row for row in rows if row.arm == Arm.BETWEEN_BUILDS]
    slowdowns = [row for row in rows if row.arm != Arm.BETWEEN_BUILDS]
    problems = dict.fromkeys(row.problem for row in rows if row.problem)
    return Section(
        "How often is a verdict wrong?",
        [_conclusion(rows, confidence)],
        tables=[_slowdown_table(slowdowns), _build_table(between)],
        notes=[
            *(f"compared as shipped: {problem}" for problem in problems),
            *_notes(rows, min_effect),
        ],
    )


def _notes(rows: Sequence[CaseSummary], min_effect: float) -> Iterator[str]:
    slowdowns = (row for row in rows if row.arm != Arm.BETWEEN_BUILDS)
    if any(row.missed is None and row.is_slower for row in slowdowns):
        yield (
            f"Slowdowns of less than {100 * min_effect:g} % (--min-effect) may be called the same:"
            " they are not counted as missed"
        )
    count = sum(row.trials for row in rows)
    undecided = sum(row.inconclusive * row.trials for row in rows)
    if undecided > _MANY * count:
        yield (
            f"{100 * undecided / count:.0f} % are undecided: give a longer --budget, or end other"
            " programs (`mjbench doctor`)"
        )


def _conclusion(rows: Sequence[CaseSummary], confidence: float) -> Conclusion:
    wrong = sum(round(row.wrong * row.trials) for row in rows)
    count = sum(row.trials for row in rows)
    if not count:
        return Conclusion("No trial was finished.", Tone.UNSURE)
    sentence = f"{wrong} of {count} verdicts on known truths are wrong"
    expected = (1 - confidence) * count
    if wrong > expected:
        advice = "do not trust them here; `mjbench doctor` says what spoils them"
        return Conclusion(f"{sentence}, more than chance: {advice}", Tone.BAD)
    # of fewer, none may be wrong by luck
    trust = ": trust `versions` and `ab` on this machine" if expected >= 1 else ""
    return Conclusion(f"{sentence}{trust}", Tone.GOOD)


def _slowdown_table(rows: Sequence[CaseSummary]) -> DataTable:
    return _table(
        "Known slowdowns",
        Column("slowdown", has_figures=True),
        rows,
        (
            Column("measured", lambda share: f"{100 * share:+.2f} %", leaves=9),
            lambda row: row.measured,
        ),
        (Column("called slower", formats.percent), lambda row: row.detected),
        (Column("wrong", formats.percent), lambda row: row.wrong),
        (Column("missed", formats.percent), lambda row: row.missed),
    )


def _build_table(rows: Sequence[CaseSummary]) -> DataTable:
    """Return the table of trials between builds that execute the same instructions."""
    return _table(
        "Builds of the same code",
        Column("old → new"),
        rows,
        (Column("different", formats.percent), lambda row: row.wrong),
        (Column("by code", formats.percent), lambda row: row.by_code),
        (Column("only as shipped", formats.percent, leaves=8), lambda row: row.by_placement),
    )


def _table(
    title: str,
    case: Column,
    rows: Sequence[CaseSummary],
    *shares: tuple[Column, Callable[[CaseSummary], Cell]],
) -> DataTable:
    return DataTable.of(
        title,
        rows,
        (Column("model"), lambda row: row.model),
        (case, describe_case),
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
