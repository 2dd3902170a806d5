"""What `mjbench history measure` comes to: a row for each release and model or operation."""

import itertools
from collections.abc import Sequence

from mjbench.releases import release_ratios, speed_history
from mjbench.releases.release_ratios import RatioRecord, StepRatioRecord
from mjbench.report import formats
from mjbench.report.content import Cell, Column, DataTable, Section
from mjbench.simulation import agreement


def section(records: Sequence[RatioRecord]) -> Section:
    """Return the ratio of each release and model, with its standard error."""
    columns = (
        Column("model or operation"),
        Column("release"),
        Column("time", formats.change_with_error),
        Column("as shipped", formats.change_with_error),
        Column("launches", formats.count),
        Column("seconds", formats.tenths),
        Column("work"),
    )
    in_order = speed_history.in_order_of_release(records)
    rows: list[Sequence[Cell]] = []
    for _, each in itertools.groupby(in_order, lambda record: (record.release, record.build)):
        of_release = list(each)
        if _failed_alike(of_release):
            first = of_release[0]
            rows.append(("all", first.release, None, None, 0, None, first.detail))
        else:
            rows += map(_cells, of_release)
    references = sorted({record.reference for record in records})
    problems = sorted({record.problem for record in records if record.problem})
    return Section(
        "Times of releases",
        tables=[DataTable("Times of releases", columns, rows)],
        notes=[
            *(f"placement not averaged out: {problem}" for problem in problems),
            f"time: of a step or an operation, against MuJoCo {', '.join(references)} (± standard"
            " error), with placement averaged out where the code can be moved; work: against the"
            " same release",
        ],
    )


def _cells(record: RatioRecord) -> Sequence[Cell]:
    return (
        record.series,
        record.release,
        release_ratios.averaged(record.launches),
        release_ratios.as_shipped(record.launches),
        len(record.launches),
        record.seconds,
        record.detail or _work(record),
    )


def _failed_alike(records: Sequence[RatioRecord]) -> bool:
    """Return whether nothing of a release could be timed, and always for one reason."""
    details = {record.detail for record in records}
    is_timed = any(record.launches for record in records)
    return len(records) > 1 and not is_timed and len(details) == 1 and "" not in details


def _work(record: RatioRecord) -> str:
    """Return how the work differs from that of the reference."""
    if not isinstance(record, StepRatioRecord):
        is_same = record.drift is not None and record.drift <= agreement.ROUNDING
        return "the same result" if is_same else "another result"
    if record.work is None or record.reference_work is None:
        return ""
    diverged = record.reference_diverged, record.diverged
    changes = agreement.work_changes(record.reference_work, record.work, record.drift, diverged)
    return "; ".join(changes) or "the same"
