"""Tables of the speed of MuJoCo over the releases, in Markdown (see `speed_page`)."""

import math
import statistics
from collections.abc import Iterator, Mapping, Sequence

from mjbench.counts.function_differences import (
    MAIN_FUNCTIONS,
    NetDifference,
    largest_differences,
)
from mjbench.counts.records import ExplainRecord
from mjbench.releases import release_ratios, speed_history
from mjbench.releases.change_points import MIN_CHANGE
from mjbench.releases.release_ratios import LogEstimate
from mjbench.releases.speed_history import Measured, SpeedSeries
from mjbench.report.markdown import change, change_with_error, code, escaped, table
from mjbench.report.speed_history import Listed, SpeedHistory, listed_changes, title
from mjbench.units import plain

# The smallest change of a count of instructions that is marked.
COUNT_THRESHOLD = 0.01
# Placement adds to a change where it is larger or smaller by this as shipped.
MIN_PLACEMENT = math.log1p(0.015)
# A change without a test of its own counts if it is as many standard errors.
DEVIATIONS = 4.0
# The smallest change of a function that is named, as a share of the step's instructions.
_MIN_SHARE = 0.0005


def step_changes(history: SpeedHistory, only: str | None = None) -> Iterator[str]:
    """Yield a table of the change points of steps, or that there are none.

    Args:
      only: the release that they came with; None for all.
    """
    listed = _listed(history, history.models, only)
    headings = ["releases", "model", "time", "instructions", "cause", "what accounts for it"]
    rows = [
        [
            *_releases(each),
            _with_error(each.point.change, each.point.deviation),
            instruction_change(each.counts),
            str(each.cause),
            "<br>".join(_accounts(each)),
        ]
        for each in listed
    ]
    return _table_or(_none_listed(), headings, rows, right_aligned=("time", "instructions"))


def operation_changes(history: SpeedHistory, only: str | None = None) -> Iterator[str]:
    """Yield a table of the change points of operations, or that there are none.

    Args:
      only: the release that they came with; None for all.
    """
    listed = _listed(history, history.operations, only)
    headings = ["releases", "operation", "time", "instructions", "cause", "what accounts for it"]
    rows = [
        [
            *_releases(each),
            _with_error(each.point.change, each.point.deviation),
            instruction_change(each.counts),
            str(each.cause),
            "<br>".join(_accounts(each)),
        ]
        for each in listed
    ]
    return _table_or(_none_listed(), headings, rows, right_aligned=("time", "instructions"))


def _listed(
    history: SpeedHistory, all_series: Sequence[SpeedSeries], only: str | None
) -> list[Listed]:
    listed = listed_changes(history, all_series)
    return [each for each in listed if only is None or each.after.release == only]


def _none_listed() -> str:
    return f"None from {100 * math.expm1(MIN_CHANGE):.0f} % on."


def _releases(listed: Listed) -> Sequence[str]:
    """Return the releases around a change, and what changed."""
    return f"{listed.before.release} → {listed.after.release}", _title(listed.series)


def _accounts(listed: Listed) -> Iterator[str]:
    """Yield what accounts for a change: work, functions, known causes."""
    if listed.work_changes:
        yield "; ".join(listed.work_changes)
    if listed.has_same_code:
        yield "both execute the same machine code"
    if _is_opposite(listed):
        yield "its instructions changed in the other direction"
    functions = _functions(listed)
    if functions:
        yield functions
    for cause in listed.causes:
        yield escaped(cause.text) + (f" ({code(cause.commit)})" if cause.commit else "")


def _functions(listed: Listed) -> str:
    """Return the functions that may account for a change, with their instructions."""
    old = listed.counts.instructions_per_step.old if listed.counts else None
    if not old:
        return ""
    return ", ".join(
        f"{code(' + '.join(d.names))} {100 * d.difference / old:+.1f} %"
        for d in _main_differences(listed)
        if abs(d.difference) >= _MIN_SHARE * old
    )


def _main_differences(listed: Listed) -> Sequence[NetDifference]:
    """Return the largest differences of functions; none where they cannot account for a change."""
    if listed.counts is None or _is_opposite(listed):
        return []
    return largest_differences(listed.counts.functions, MAIN_FUNCTIONS)


def _is_opposite(listed: Listed) -> bool:
    """Return whether instructions changed in the other direction than the time."""
    per_step = listed.counts.instructions_per_step if listed.counts else None
    if per_step is None or not per_step.old or not per_step.new:
        return False
    return (per_step.new - per_step.old) * listed.point.change < 0


def instruction_change(counts: ExplainRecord | None) -> str:
    """Return the change of instructions; empty where they were not counted."""
    if counts is None:
        return ""
    old, new = counts.instructions_per_step.old, counts.instructions_per_step.new
    return f"{100 * (new / old - 1):+.1f} %" if old and new else ""


def excursions(history: SpeedHistory) -> Iterator[str]:
    """Yield a table of single releases that are off, or that there are none."""
    rows = [
        [after.release, _title(series), log_change(excursion.change), _work(before, after)]
        for series in (*history.models, *history.operations)
        for excursion in series.changes.excursions
        for before, after in [series.pair(excursion.index)]
        if history.lists(after.release)
    ]
    headings = ["release", "model or operation", "time", "work"]
    return _table_or("None.", headings, rows, right_aligned=("time",))


def drifts(history: SpeedHistory) -> Iterator[str]:
    """Yield a table of slow changes, or that there are none."""
    rows = [
        [
            f"{series.measured[drift.begin].release} to {series.measured[drift.end - 1].release}",
            _title(series),
            log_change(drift.change),
        ]
        for series in (*history.models, *history.operations)
        for drift in series.changes.drifts
        if history.lists(series.measured[drift.end - 1].release)
    ]
    headings = ["releases", "model or operation", "time"]
    return _table_or("None.", headings, rows, right_aligned=("time",))


def placement(history: SpeedHistory) -> Iterator[str]:
    """Yield a table of changes of steps to which placement adds, or that there are none."""
    rows = [
        [after.release, _title(series), log_change(shipped), log_change(averaged)]
        for series in history.models
        for index in range(1, len(series.measured))
        for before, after in [series.pair(index)]
        if history.lists(after.release)
        for averaged in [after.ratio.log_ratio - before.ratio.log_ratio]
        if (shipped := _shipped_change(before, after, averaged)) is not None
    ]
    numbers = ("as shipped", "averaged")
    return _table_or("None.", ["release", "model", *numbers], rows, right_aligned=numbers)


def _shipped_change(before: Measured, after: Measured, averaged: float) -> float | None:
    """Return the change as shipped where placement certainly adds to it; None otherwise."""
    old, new = (release_ratios.as_shipped(each.record.launches) for each in (before, after))
    if old is None or new is None:
        return None
    shipped = new.log_ratio - old.log_ratio
    ratios = (old, new, before.ratio, after.ratio)
    deviation = math.sqrt(sum(ratio.deviation**2 for ratio in ratios))
    is_certain = abs(shipped - averaged) >= max(MIN_PLACEMENT, DEVIATIONS * deviation)
    return shipped if is_certain else None


def totals(all_series: Sequence[SpeedSeries]) -> Iterator[str]:
    """Yield a table of the change from the first release to the last."""
    rows = [
        [
            _title(series),
            first.release,
            last.release,
            _with_error(total.log_ratio, total.deviation),
            str(len(series.changes.change_points)),
            _work(first, last),
        ]
        for series in all_series
        if len(series.measured) > 1
        for first, last, total in [(series.measured[0], series.measured[-1], total_of(series))]
    ]
    headings = ["", "first", "last", "time", "change points", "work"]
    return _table_or("None.", headings, rows, right_aligned=("time", "change points"))


def times(history: SpeedHistory, all_series: Sequence[SpeedSeries]) -> Iterator[str]:
    """Yield a table of microseconds, by release and by model or operation."""
    columns = [_times(series) for series in all_series]
    return _by_release(history, [_title(series) for series in all_series], columns)


def _times(series: SpeedSeries) -> Mapping[str, str]:
    """Return microseconds by release, change points marked; empty where they are not known."""
    known = [
        each.record.reference_s for each in series.measured if each.record.reference_s is not None
    ]
    if not known:
        return {}
    reference_us = 1e6 * statistics.median(known)
    marks = {point.index: _mark(point.change) for point in series.changes.change_points}
    return {
        each.release: plain(reference_us * each.ratio.ratio, 3) + marks.get(i, "")
        for i, each in enumerate(series.measured)
    }


def instructions(history: SpeedHistory) -> Iterator[str]:
    """Yield a table of thousands of instructions of a step, by release and model."""
    if not history.background.counts:
        return iter(["Not counted; `mjbench history explain` counts them."])
    columns = [_instructions_by_release(history, series.name) for series in history.models]
    return _by_release(history, [_title(series) for series in history.models], columns)


def _instructions_by_release(history: SpeedHistory, model: str) -> Mapping[str, str]:
    """Return a model's thousands of instructions by release, changes marked."""
    counts = history.instructions(model)
    cells: dict[str, str] = {}
    before: float | None = None
    for release in history.releases():
        count = counts.get(release)
        if count is not None:
            is_change = before is not None and abs(count / before - 1) > COUNT_THRESHOLD
            mark = _mark(count - before) if before is not None and is_change else ""
            cells[release] = plain(count / 1000, 4) + mark
        before = count
    return cells


def _by_release(
    history: SpeedHistory, names: Sequence[str], columns: Sequence[Mapping[str, str]]
) -> Iterator[str]:
    """Yield a table with a row for each release; `columns` hold the cells of each name."""
    rows = (
        [release, *(column.get(release, "–") for column in columns)]
        for release in history.releases()
        if history.lists(release)
    )
    return table(["release", *names], rows, right_aligned=names)


def work(history: SpeedHistory) -> Iterator[str]:
    """Yield a table of releases in which work or results changed, or that there are none."""
    changed: dict[str, list[str]] = {}
    for series in (*history.models, *history.operations):
        for index in range(1, len(series.measured)):
            before, after = series.pair(index)
            changes = speed_history.work_changes(before, after)
            if changes:
                changed.setdefault(after.release, []).append(
                    f"{_title(series)}: {', '.join(changes)}"
                )
    rows = [
        [release, "<br>".join(changed[release])]
        for release in history.releases()
        if release in changed and history.lists(release)
    ]
    return _table_or("None.", ["release", "what changed"], rows)


def failures(history: SpeedHistory) -> Iterator[str]:
    """Yield a table of what a release failed in."""
    rows = [
        [record.release, title(record), escaped(record.detail)]
        for record in history.failures
        if history.lists(record.release)
    ]
    return _table_or("None.", ["release", "model or operation", "how"], rows)


def _title(series: SpeedSeries) -> str:
    return title(series.measured[-1].record)


def total_of(series: SpeedSeries) -> LogEstimate:
    """Return the time in the last release over that in the first."""
    return speed_history.change(series.measured[0], series.measured[-1])


def log_change(log_ratio: float) -> str:
    """Return a log ratio as a change in percent, or as a factor (see `markdown.change`)."""
    return change(math.exp(log_ratio))


def _with_error(log_ratio: float, deviation: float) -> str:
    return change_with_error(math.exp(log_ratio), deviation)


def _mark(difference: float) -> str:
    return "▲" if difference > 0 else "▼"


def _work(before: Measured, after: Measured) -> str:
    if not speed_history.knows_work(before, after):
        return "unknown"
    return "; ".join(speed_history.work_changes(before, after)) or "the same"


def _table_or(
    nothing: str,
    headings: Sequence[str],
    rows: Sequence[Sequence[str]],
    right_aligned: Sequence[str] = (),
) -> Iterator[str]:
    """Return a table, or a line in its place where it has no rows."""
    return table(headings, rows, right_aligned) if rows else iter([nothing])
