"""What was timed: a row for each release and model or operation."""

import itertools
from collections.abc import Sequence

from benchmarks.history import release_ratios, speed_series
from benchmarks.history.log_estimates import change_with_error
from benchmarks.history.release_ratios import RatioRecord, StepRatioRecord
from mjbench import formats
from mjbench.results.content import Column, DataTable, Section
from mjbench.simulation import changed_work


def section(records: Sequence[RatioRecord]) -> Section:
    rows: list[tuple[str, str, RatioRecord]] = []
    in_order = speed_series.in_order_of_release(records)
    for _, each in itertools.groupby(in_order, lambda record: (record.release, record.build)):
        of_release = list(each)
        details = {record.detail for record in of_release}
        is_timed = any(record.launches for record in of_release)
        if len(of_release) > 1 and not is_timed and len(details) == 1 and "" not in details:
            rows.append(("all", of_release[0].detail, of_release[0]))
        else:
            rows += [(r.series, r.detail or _work(r), r) for r in of_release]
    table = DataTable.of(
        "Times of releases",
        rows,
        (Column("model or operation"), lambda row: row[0]),
        (Column("release"), lambda row: row[2].release),
        (
            Column("time", has_figures=True),
            lambda row: change_with_error(release_ratios.averaged(row[2].launches)),
        ),
        (
            Column("as shipped", has_figures=True, leaves=3),
            lambda row: change_with_error(release_ratios.as_shipped(row[2].launches)),
        ),
        (Column("launches", formats.count, leaves=2), lambda row: len(row[2].launches)),
        (Column("seconds", formats.tenths, leaves=1), lambda row: row[2].seconds or None),
        (Column("work"), lambda row: row[1]),
    )
    references = sorted({record.reference for record in records})
    problems = sorted({record.problem for record in records if record.problem})
    return Section(
        "Times of releases",
        tables=[table],
        notes=[
            *(f"placement not averaged out: {problem}" for problem in problems),
            f"time: of a step or an operation, against MuJoCo {', '.join(references)} (± standard"
            " error), with placement averaged out where the code can be moved; work: against the"
            " same release",
        ],
    )


def _work(record: RatioRecord) -> str:
    if not isinstance(record, StepRatioRecord):
        is_same = record.drift is not None and record.drift <= changed_work.ROUNDING
        return "the same result" if is_same else "another result"
    if record.work is None or record.reference_work is None:
        return ""
    diverged = record.reference_diverged, record.diverged
    changes = changed_work.work_changes(record.reference_work, record.work, record.drift, diverged)
    return "; ".join(changes) or "the same"
