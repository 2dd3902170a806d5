"""What one release changed, beside the release before it, as a page in Markdown."""

from collections.abc import Iterator, Sequence

from mjbench.releases import speed_history
from mjbench.releases.speed_history import Measured, SpeedSeries
from mjbench.report.markdown import change_with_error, code, escaped, table
from mjbench.report.speed_history import SpeedHistory, listed_changes
from mjbench.report.speed_tables import instruction_change, operation_changes, step_changes


def lines(history: SpeedHistory, release: str) -> Iterator[str]:
    """Yield a page: the conclusion, what is listed, and every model.

    Args:
      history: of releases; the release is not the first of it.
    """
    yield f"# MuJoCo {release}\n"
    yield conclusion(history, release)
    yield "\n## Change points of a step\n"
    yield from step_changes(history, only=release)
    if history.operations:
        yield "\n## Change points around the step\n"
        yield from operation_changes(history, only=release)
    yield "\n## All models\n"
    yield (
        "The change from the release before that loads the model, with its standard error. Changes"
        " that are not listed above may be chance.\n"
    )
    rows = [_row(history, series, *pair) for series, pair in _pairs(history, release)]
    headings = ["model", "from", "time", "instructions", "work"]
    yield from table(headings, rows, right_aligned=("time", "instructions"))


def conclusion(history: SpeedHistory, release: str) -> str:
    """Return how many models became slower or faster in a release, in a sentence."""
    compared = len(list(_pairs(history, release)))
    listed = [e for e in listed_changes(history, history.models) if e.after.release == release]
    slower = sorted(escaped(each.series.name) for each in listed if each.point.change > 0)
    faster = sorted(escaped(each.series.name) for each in listed if each.point.change < 0)
    parts = [
        f"{direction} for {len(names)} of {compared} models ({', '.join(names)})"
        for direction, names in (("slower", slower), ("faster", faster))
        if names
    ]
    if not compared:
        return "No model was timed both in it and before it."
    if not parts:
        return f"No change point of a step among {compared} models."
    return f"A step became {' and '.join(parts)}."


def _pairs(
    history: SpeedHistory, release: str
) -> Iterator[tuple[SpeedSeries, tuple[Measured, Measured]]]:
    """Yield each model that was measured in a release and before it, with both."""
    for series in history.models:
        releases = [each.release for each in series.measured]
        if release in releases[1:]:
            yield series, series.pair(releases.index(release))


def _row(
    history: SpeedHistory, series: SpeedSeries, before: Measured, after: Measured
) -> Sequence[str]:
    change = speed_history.change(before, after)
    counts = history.background.counts.get((series.name, before.release, after.release))
    return (
        code(series.name),
        before.release,
        change_with_error(change.ratio, change.deviation),
        instruction_change(counts),
        "; ".join(speed_history.work_changes(before, after)) or "same",
    )
