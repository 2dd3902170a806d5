"""Tables of the changes of speed between releases."""

import math
from collections.abc import Iterator, Sequence

from benchmarks.history.log_estimates import LogEstimate, change_with_error
from benchmarks.history.speed_history import Listed, SpeedHistory, listed_changes
from mjbench import formats
from mjbench.counts.explain import largest_differences
from mjbench.counts.records import ExplainRecord
from mjbench.results.content import Column, DataTable

# The smallest change that has a row: a run beside other work had changes that differ by as much
# (docs/method/history.md). Plots mark the smaller ones, too.
MIN_CHANGE = math.log1p(0.05)
# The same around the step, of which there are more.
MIN_OPERATION_CHANGE = math.log1p(0.15)
# The smallest change of a function that is named, as a share of the step's instructions.
_MIN_SHARE = 0.0005


def step_changes(history: SpeedHistory) -> DataTable:
    listed = listed_changes(history, history.models)
    return _change_points("Change points of a step", "model", listed, MIN_CHANGE)


def operation_changes(history: SpeedHistory) -> DataTable:
    listed = listed_changes(history, history.operations)
    return _change_points(
        "Change points around the step", "operation", listed, MIN_OPERATION_CHANGE
    )


def _change_points(heading: str, noun: str, listed: Sequence[Listed], least: float) -> DataTable:
    return DataTable.of(
        heading,
        [each for each in listed if abs(each.point.change) >= least],
        (Column("releases"), lambda each: f"{each.before.release} → {each.after.release}"),
        (Column(noun), lambda each: each.title),
        (
            Column("time", has_figures=True),
            lambda each: change_with_error(LogEstimate(each.point.change, each.point.deviation)),
        ),
        (
            Column("instructions", formats.change_to_tenth),
            lambda each: _instruction_ratio(each.counts),
        ),
        (Column("cause"), lambda each: each.cause.value),
        (Column("what accounts for it", wraps=True), lambda each: "; ".join(_accounts(each))),
    )


def _instruction_ratio(counts: ExplainRecord | None) -> float | None:
    if counts is None:
        return None
    old, new = counts.instructions_per_step.old, counts.instructions_per_step.new
    return new / old if old and new else None


def _accounts(listed: Listed) -> Iterator[str]:
    """Yield what accounts for a change: work, functions, known causes."""
    yield from listed.work_changes
    ratio = _instruction_ratio(listed.counts)
    if ratio is not None and (ratio - 1) * listed.point.change < 0:
        yield "its instructions changed in the other direction"
    elif not listed.causes:
        yield from _function(listed.counts)
    for cause in listed.causes:
        yield cause.text + (f" ({cause.commit})" if cause.commit else "")


def _function(counts: ExplainRecord | None) -> Iterator[str]:
    """Yield the function whose instructions changed most, if it may account for a change."""
    old = counts.instructions_per_step.old if counts else None
    if counts is None or not old:
        return
    for d in largest_differences(counts.functions, 1):
        if abs(d.difference) >= _MIN_SHARE * old:
            yield f"{' + '.join(d.names)} {100 * d.difference / old:+.1f} %"
