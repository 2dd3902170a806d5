"""Tables of the speed of MuJoCo over the releases."""

import itertools
import math
import statistics
from collections.abc import Callable, Iterator, Mapping, Sequence

from benchmarks.history import change_points, release_ratios, speed_series
from benchmarks.history.speed_history import Listed, SpeedHistory, listed_changes, title
from benchmarks.history.speed_series import MeasuredRelease, SpeedSeries
from mjbench.counts.function_differences import largest_differences
from mjbench.counts.records import ExplainRecord
from mjbench.measuring.ratio import LogEstimate
from mjbench.report import formats
from mjbench.report.content import Column, DataTable
from mjbench.report.counts import MAIN_FUNCTIONS
from mjbench.units import plain

# The smallest change of a count of instructions that is marked.
COUNT_THRESHOLD = 0.01
# Placement adds to a change where it is larger or smaller by this as shipped.
MIN_PLACEMENT = math.log1p(0.015)
# The smallest change of a function that is named, as a share of the step's instructions.
_MIN_SHARE = 0.0005
_WHERE = (Column("release"), Column("model or operation"))


def step_changes(history: SpeedHistory) -> DataTable:
    listed = listed_changes(history, history.models)
    return _change_points("Change points of a step", "model", listed)


def operation_changes(history: SpeedHistory) -> DataTable:
    listed = listed_changes(history, history.operations)
    return _change_points("Change points around the step", "operation", listed)


def _change_points(heading: str, noun: str, listed: Sequence[Listed]) -> DataTable:
    return DataTable.of(
        heading,
        listed,
        (Column("releases"), lambda each: f"{each.before.release} → {each.after.release}"),
        (Column(noun), lambda each: each.title),
        (
            Column("time", formats.change_with_error),
            lambda each: LogEstimate(each.point.change, each.point.deviation),
        ),
        (
            Column("instructions", formats.change_to_tenth),
            lambda each: _instruction_ratio(each.counts),
        ),
        (Column("cause"), lambda each: each.cause.value),
        (Column("what accounts for it", wraps=True), lambda each: "; ".join(_accounts(each))),
    )


def pairs(
    history: SpeedHistory, release: str
) -> Iterator[tuple[SpeedSeries, MeasuredRelease, MeasuredRelease]]:
    """Yield each model that was measured in a release and before it, with both."""
    for series in history.models:
        releases = [each.release for each in series.measured]
        if release in releases[1:]:
            yield series, *series.pair(releases.index(release))


def _instruction_ratio(counts: ExplainRecord | None) -> float | None:
    return None if counts is None else counts.instruction_ratio


def _accounts(listed: Listed) -> Iterator[str]:
    """Yield what accounts for a change: work, functions, known causes."""
    yield from listed.work_changes
    ratio = _instruction_ratio(listed.counts)
    if ratio is not None and (ratio - 1) * listed.point.change < 0:
        yield "its instructions changed in the other direction"
    elif functions := _functions(listed.counts):
        yield functions
    for cause in listed.causes:
        yield cause.text + (f" ({cause.commit})" if cause.commit else "")


def _functions(counts: ExplainRecord | None) -> str:
    """Return the functions that may account for a change, with their instructions."""
    old = counts.instructions_per_step.old if counts else None
    if counts is None or not old:
        return ""
    return ", ".join(
        f"{' + '.join(d.names)} {100 * d.difference / old:+.1f} %"
        for d in largest_differences(counts.functions, MAIN_FUNCTIONS)
        if abs(d.difference) >= _MIN_SHARE * old
    )


def excursions(history: SpeedHistory) -> DataTable:
    return DataTable(
        "Single releases that are off",
        (*_WHERE, Column("time", formats.log_change), Column("work", wraps=True)),
        [
            (after.release, _title(series), excursion.change, _work_between(before, after))
            for series in history.all_series
            for excursion in series.changes.excursions
            for before, after in [series.pair(excursion.index)]
            if history.lists(after.release)
        ],
    )


def drifts(history: SpeedHistory) -> DataTable:
    return DataTable(
        "Drifts",
        (Column("releases"), Column("model or operation"), Column("time", formats.log_change)),
        [
            (f"{begin} to {end}", _title(series), drift.change)
            for series in history.all_series
            for drift in series.changes.drifts
            for begin, end in [(series.measured[i].release for i in (drift.begin, drift.end - 1))]
            if history.lists(end)
        ],
    )


def placement(history: SpeedHistory) -> DataTable:
    """Return the changes of steps to which placement adds."""
    return DataTable(
        "Changed by placement",
        (
            Column("release"),
            Column("model"),
            Column("as shipped", formats.log_change),
            Column("averaged", formats.log_change),
        ),
        [
            (after.release, series.name, shipped, averaged)
            for series in history.models
            for index in range(1, len(series.measured))
            for before, after in [series.pair(index)]
            if history.lists(after.release)
            for averaged in [after.ratio.log_ratio - before.ratio.log_ratio]
            if (shipped := _shipped_change(before, after, averaged)) is not None
        ],
    )


def _shipped_change(
    before: MeasuredRelease, after: MeasuredRelease, averaged: float
) -> float | None:
    """Return the change as shipped where placement certainly adds to it; None otherwise."""
    old, new = (release_ratios.as_shipped(each.record.launches) for each in (before, after))
    if old is None or new is None:
        return None
    shipped = new.log_ratio - old.log_ratio
    ratios = (old, new, before.ratio, after.ratio)
    deviation = math.sqrt(sum(ratio.deviation**2 for ratio in ratios))
    least = max(MIN_PLACEMENT, change_points.MIN_DEVIATIONS * deviation)
    return shipped if abs(shipped - averaged) >= least else None


def totals(history: SpeedHistory) -> DataTable:
    return DataTable.of(
        "From the first release to the last",
        [series for series in history.all_series if len(series.measured) > 1],
        (Column("model or operation"), _title),
        (Column("first"), lambda series: series.measured[0].release),
        (Column("last"), lambda series: series.measured[-1].release),
        (Column("time", formats.change_with_error), total),
        (Column("change points", formats.count), lambda s: len(s.changes.change_points)),
        (Column("work", wraps=True), lambda s: _work_between(s.measured[0], s.measured[-1])),
    )


def _by_release(
    heading: str,
    history: SpeedHistory,
    all_series: Sequence[SpeedSeries],
    cells: Callable[[SpeedSeries], Mapping[str, str]],
) -> DataTable:
    """Return a table with a row for each release; `cells` returns those of a series by it."""
    releases = [release for release in history.releases() if history.lists(release)]
    columns = [cells(series) for series in all_series]
    return DataTable(
        heading,
        [Column("release"), *(Column(_title(series), str) for series in all_series)],
        [[release, *(column.get(release, "–") for column in columns)] for release in releases],
    )


def step_times(history: SpeedHistory) -> DataTable:
    return _by_release("Time of a step", history, history.models, _times)


def operation_times(history: SpeedHistory) -> DataTable:
    return _by_release("Time of operations", history, history.operations, _times)


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


def instructions(history: SpeedHistory) -> DataTable:
    """Return thousands of instructions of a step, by release and model; empty without counts."""
    if not history.counts:
        return DataTable("Instructions of a step", (), ())

    def cells(series: SpeedSeries) -> Mapping[str, str]:
        """Return a model's thousands of instructions by release, changes marked."""
        counts, marks = history.instructions(series.name), dict[str, str]()
        for before, release in itertools.pairwise(history.releases()):
            if before in counts and release in counts:
                change = counts[release] / counts[before] - 1
                marks[release] = _mark(change) if abs(change) > COUNT_THRESHOLD else ""
        return {
            release: plain(count / 1000, 4) + marks.get(release, "")
            for release, count in counts.items()
        }

    return _by_release("Instructions of a step", history, history.models, cells)


def _mark(difference: float) -> str:
    return "▲" if difference > 0 else "▼"


def work(history: SpeedHistory) -> DataTable:
    return DataTable(
        "Releases that compute something else",
        (*_WHERE, Column("what changed", wraps=True)),
        [
            (release, _title(series), ", ".join(changes))
            for release in history.releases()
            if history.lists(release)
            for series in history.all_series
            for index, after in enumerate(series.measured)
            if index and after.release == release
            if (changes := speed_series.work_changes(*series.pair(index)))
        ],
    )


def failures(history: SpeedHistory) -> DataTable:
    return DataTable.of(
        "Measurements that failed",
        [record for record in history.failures if history.lists(record.release)],
        (Column("release"), lambda record: record.release),
        (Column("model or operation"), title),
        (Column("how", wraps=True), lambda record: record.detail),
    )


def _title(series: SpeedSeries) -> str:
    return title(series.measured[-1].record)


def total(series: SpeedSeries) -> LogEstimate:
    return speed_series.change(series.measured[0], series.measured[-1])


def _work_between(before: MeasuredRelease, after: MeasuredRelease) -> str:
    if not speed_series.knows_work(before, after):
        return "unknown"
    return "; ".join(speed_series.work_changes(before, after)) or "the same"
