"""The page of `mjbench history changes`, in Markdown."""

import math
import statistics
from collections.abc import Iterator, Mapping, Sequence

from mjbench.counts.function_differences import MAIN_FUNCTIONS, largest_differences
from mjbench.counts.records import ExplainRecord
from mjbench.releases import release_ratios, speed_history
from mjbench.releases.change_points import MIN_CHANGE
from mjbench.releases.changelog import Changelog
from mjbench.releases.history import COUNT_THRESHOLD
from mjbench.releases.release import version_key
from mjbench.releases.release_ratios import Ratio
from mjbench.releases.speed_history import Measured, ModelHistory
from mjbench.report import tables
from mjbench.report.markdown import change, table
from mjbench.report.speed_history import Listed, SpeedHistory, listed_changes

# As many of the largest changes are named in the conclusion.
_LARGEST_CHANGES = 3
# As many characters are quoted of an item of the changelog.
_MAX_QUOTED = 160
# A change without a test of its own counts if it is as many standard errors.
_DEVIATIONS = 4.0
# Placement adds to a change where shipped and averaged ones differ by this, too.
_MIN_PLACEMENT = math.log1p(0.015)


def lines(history: SpeedHistory) -> Iterator[str]:
    """Yield the sections of a page on the time of a step, in Markdown."""
    listed = listed_changes(history)
    yield from conclusion(history.models, listed)
    yield "\n## Change points\n"
    yield (
        "Changes of the time of a step from one release to the next, from 1 % on, with their"
        " standard error. The cause is `work` where a step has other work to do, `code` where the"
        " same work takes another time with placement averaged out, and `undecided` where that is"
        " not known. The percentage after a function is the change of its instructions, relative to"
        " those of the step.\n"
    )
    yield from changes_table(listed, history.changelog)
    yield "\n## Single releases that are off\n"
    yield "Changes that the next release takes back.\n"
    yield from excursions_table(history)
    yield "\n## Drifts\n"
    yield "Slow changes, of which no single one is a change point.\n"
    yield from drifts_table(history)
    yield "\n## Changed by placement\n"
    yield (
        "Changes that differ by at least 1.5 % where placement is averaged out: the difference"
        " comes from where the code lies in memory. Few launches are as shipped, so that only large"
        " differences are seen.\n"
    )
    yield from placement_table(history)
    yield "\n## From the first release to the last\n"
    yield from totals_table(history.models)
    yield "\n## Time of a step\n"
    yield (
        "Microseconds of one `mj_step` from Python: the ratio to the reference, times the"
        " reference's own time, which is the median of all runs of the model. ▲ and ▼ mark change"
        " points.\n"
    )
    yield from times_table(history)
    yield "\n## Instructions of a step\n"
    yield (
        "Thousands of instructions of one `mj_step`, counted by Callgrind. ▲ and ▼ mark changes"
        f" above {100 * COUNT_THRESHOLD:g} % from the release before. A count says what the code"
        " does, not how long it takes.\n"
    )
    yield from instructions_table(history)
    yield "\n## Releases that compute something else\n"
    yield "Compared with the release before: the work of a step, and the result of one step.\n"
    yield from work_table(history)


def conclusion(models: Sequence[ModelHistory], listed: Sequence[Listed]) -> Iterator[str]:
    """Yield sentences: from the first release to the last, and the largest changes."""
    totals = [_total(model) for model in models if len(model.measured) > 1]
    certain = [total.log_ratio for total in totals if _is_certain(total)]
    slower = [log_ratio for log_ratio in certain if log_ratio > 0]
    faster = [log_ratio for log_ratio in certain if log_ratio < 0]
    yield (
        f"From the first release measured to the last, a step became slower for {len(slower)} of"
        f" {len(totals)} models{_range(slower)}, and faster for {len(faster)}{_range(faster)}."
    )
    largest = sorted(listed, key=lambda c: -abs(c.point.change))[:_LARGEST_CHANGES]
    if largest:
        texts = [
            f"{_change(c.point.change)} for `{c.model.model}` in {c.after.release}" for c in largest
        ]
        yield f"The largest changes from one release to the next are {', '.join(texts)}."


def changes_table(listed: Sequence[Listed], changelog: Changelog | None) -> Iterator[str]:
    """Yield a Markdown table of change points, or that there are none."""
    if not listed:
        return iter([f"None from {100 * math.expm1(MIN_CHANGE):.0f} % on."])
    headings = ["releases", "model", "time", "instructions", "cause", "what accounts for it"]
    rows = (_change_row(each, changelog) for each in listed)
    return table(headings, rows, right_aligned=("time", "instructions"))


def _change_row(listed: Listed, changelog: Changelog | None) -> Sequence[str]:
    return (
        f"{listed.before.release} → {listed.after.release}",
        f"`{listed.model.model}`",
        f"{_change(listed.point.change)} ±{100 * listed.point.deviation:.1f}",
        _instructions(listed.counts),
        str(listed.cause),
        "<br>".join(_accounts(listed, changelog)),
    )


def _accounts(listed: Listed, changelog: Changelog | None) -> Iterator[str]:
    """Yield what accounts for a change: work, functions, and an item of the changelog."""
    if listed.work_changes:
        yield "; ".join(listed.work_changes)
    functions = _functions(listed.counts)
    if functions:
        yield functions
    if changelog is not None and listed.counts is not None:
        names = [
            name
            for difference in largest_differences(listed.counts.functions, MAIN_FUNCTIONS)
            for name in difference.names
        ]
        features = speed_history.changed_counters(listed.before, listed.after)
        item = changelog.fitting(listed.after.release, names, features)
        if item is not None:
            text = item.text
            quoted = text if len(text) <= _MAX_QUOTED else f"{text[:_MAX_QUOTED]}…"
            quoted = quoted.replace("|", "\\|")
            commits = f" ({', '.join(f'`{c}`' for c in item.commits)})" if item.commits else ""
            yield f"changelog, perhaps: “{quoted}”{commits}"


def _functions(counts: ExplainRecord | None) -> str:
    """Return the functions that account for most of a difference, with their instructions."""
    if counts is None or not counts.instructions_per_step.old:
        return ""
    total = counts.instructions_per_step.old
    return ", ".join(
        f"`{' + '.join(d.names)}` {100 * d.difference / total:+.1f} %"
        for d in largest_differences(counts.functions, MAIN_FUNCTIONS)
    )


def _instructions(counts: ExplainRecord | None) -> str:
    if counts is None:
        return ""
    old, new = counts.instructions_per_step.old, counts.instructions_per_step.new
    return f"{100 * (new / old - 1):+.1f} %" if old and new else ""


def excursions_table(history: SpeedHistory) -> Iterator[str]:
    """Yield a Markdown table of single releases that are off, or that there are none."""
    rows = [
        (after.release, f"`{model.model}`", _change(excursion.change), _work(before, after))
        for model in history.models
        for excursion in model.changes.excursions
        for before, after in [model.pair(excursion.index)]
        if history.lists(after.release)
    ]
    if not rows:
        return iter(["None."])
    return table(["release", "model", "time", "work"], rows, right_aligned=("time",))


def drifts_table(history: SpeedHistory) -> Iterator[str]:
    """Yield a Markdown table of slow changes, or that there are none."""
    rows = [
        (
            f"{model.measured[drift.begin].release} to {model.measured[drift.end - 1].release}",
            f"`{model.model}`",
            _change(drift.change),
        )
        for model in history.models
        for drift in model.changes.drifts
        if history.lists(model.measured[drift.end - 1].release)
    ]
    if not rows:
        return iter(["None."])
    return table(["releases", "model", "time"], rows, right_aligned=("time",))


def placement_table(history: SpeedHistory) -> Iterator[str]:
    """Yield a Markdown table of changes to which placement adds, or that there are none."""
    rows = [
        (after.release, f"`{model.model}`", _change(shipped), _change(averaged))
        for model in history.models
        for index in range(1, len(model.measured))
        for before, after in [model.pair(index)]
        if history.lists(after.release)
        for averaged in [after.ratio.log_ratio - before.ratio.log_ratio]
        if (shipped := _shipped_change(before, after, averaged)) is not None
    ]
    if not rows:
        return iter(["None."])
    headings = ["release", "model", "as shipped", "averaged"]
    return table(headings, rows, right_aligned=("as shipped", "averaged"))


def _shipped_change(before: Measured, after: Measured, averaged: float) -> float | None:
    """Return the change as shipped where placement certainly adds to it; None otherwise."""
    old, new = (release_ratios.as_shipped(each.record.launches) for each in (before, after))
    if old is None or new is None:
        return None
    shipped = new.log_ratio - old.log_ratio
    ratios = (old, new, before.ratio, after.ratio)
    deviation = math.sqrt(sum(ratio.deviation**2 for ratio in ratios))
    is_certain = abs(shipped - averaged) >= max(_MIN_PLACEMENT, _DEVIATIONS * deviation)
    return shipped if is_certain else None


def totals_table(models: Sequence[ModelHistory]) -> Iterator[str]:
    """Yield a Markdown table of the change from the first release to the last."""
    rows = [
        (
            f"`{model.model}`",
            first.release,
            last.release,
            f"{_change(total.log_ratio)} ±{100 * total.deviation:.1f}",
            str(len(model.changes.change_points)),
            _work(first, last),
        )
        for model in models
        if len(model.measured) > 1
        for first, last, total in [(model.measured[0], model.measured[-1], _total(model))]
    ]
    headings = ["model", "first", "last", "time", "change points", "work"]
    return table(headings, rows, right_aligned=("time", "change points"))


def times_table(history: SpeedHistory) -> Iterator[str]:
    """Yield a Markdown table of the microseconds of a step, by release and model."""
    columns = [_times(model) for model in history.models]
    return _by_release(history, columns)


def _times(model: ModelHistory) -> Mapping[str, str]:
    """Return the time of a step by release, change points marked; empty where it is not known."""
    times = [each.record.reference_s for each in model.measured]
    known = [step_s for step_s in times if step_s is not None]
    if not known:
        return {}
    reference_us = 1e6 * statistics.median(known)
    marks = {point.index: _mark(point.change) for point in model.changes.change_points}
    return {
        each.release: tables.plain(reference_us * each.ratio.ratio, 3) + marks.get(i, "")
        for i, each in enumerate(model.measured)
    }


def instructions_table(history: SpeedHistory) -> Iterator[str]:
    """Yield a Markdown table of thousands of instructions of a step, by release and model."""
    if not history.counts:
        return iter(["Not counted; `mjbench history explain` counts them."])
    columns = [_instructions_by_release(history, model.model) for model in history.models]
    return _by_release(history, columns)


def _instructions_by_release(history: SpeedHistory, model: str) -> Mapping[str, str]:
    """Return a model's thousands of instructions by release, changes marked."""
    counts = history.instructions(model)
    cells: dict[str, str] = {}
    before = 0.0
    for release in sorted(counts, key=version_key):
        count = counts[release]
        is_change = before and abs(count / before - 1) > COUNT_THRESHOLD
        cells[release] = tables.plain(count / 1000, 4) + (
            _mark(count - before) if is_change else ""
        )
        before = count
    return cells


def _by_release(history: SpeedHistory, columns: Sequence[Mapping[str, str]]) -> Iterator[str]:
    """Yield a table with a row for each release; `columns` hold the cells of each model."""
    names = [f"`{model.model}`" for model in history.models]
    rows = (
        [release, *(column.get(release, "–") for column in columns)]
        for release in history.releases()
        if history.lists(release)
    )
    return table(["release", *names], rows, right_aligned=names)


def work_table(history: SpeedHistory) -> Iterator[str]:
    """Yield a Markdown table of releases in which work changed, or that there are none."""
    changed: dict[str, list[str]] = {}
    for model in history.models:
        for index in range(1, len(model.measured)):
            before, after = model.pair(index)
            changes = speed_history.work_changes(before, after)
            if changes:
                changed.setdefault(after.release, []).append(
                    f"`{model.model}`: {', '.join(changes)}"
                )
    rows = [
        (release, "<br>".join(changed[release]))
        for release in history.releases()
        if release in changed and history.lists(release)
    ]
    return table(["release", "model: what changed"], rows) if rows else iter(["None."])


def _mark(difference: float) -> str:
    return "▲" if difference > 0 else "▼"


def _change(log_ratio: float) -> str:
    """Return a log ratio as a change in percent, or as a factor (see `markdown.change`)."""
    return change(math.exp(log_ratio))


def _total(model: ModelHistory) -> Ratio:
    return speed_history.change(model.measured[0], model.measured[-1])


def _is_certain(total: Ratio) -> bool:
    return abs(total.log_ratio) >= max(MIN_CHANGE, _DEVIATIONS * total.deviation)


def _range(log_ratios: Sequence[float]) -> str:
    """Return in brackets how large changes are, smallest to largest; empty without any."""
    if not log_ratios:
        return ""
    ordered = sorted(log_ratios, key=abs)
    if len(ordered) == 1:
        return f" ({_change(ordered[0])})"
    return f" ({_change(ordered[0])} to {_change(ordered[-1])})"


def _work(before: Measured, after: Measured) -> str:
    return "; ".join(speed_history.work_changes(before, after)) or "the same"
