"""What a page says of the history of the time of a step, in Markdown.

All of it comes from ratios to one fixed release (`mjbench history measure`) and from counts by
function (`mjbench history explain`).
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from mjbench.counts.function_differences import MAIN_FUNCTIONS, largest_differences
from mjbench.counts.records import ExplainRecord
from mjbench.paired.outcomes import Cause
from mjbench.releases import speed_history, step_ratios
from mjbench.releases.change_points import MIN_CHANGE, ChangePoint
from mjbench.releases.changelog import Changelog
from mjbench.releases.release import version_key
from mjbench.releases.speed_history import Measured, ModelHistory
from mjbench.releases.step_ratios import StepRatioRecord
from mjbench.report.markdown import change, table

# As many of the largest changes are named in the conclusion.
_LARGEST_CHANGES = 3
# As many characters are quoted of an item of the changelog.
_MAX_QUOTED = 160
# Placement adds to a change where shipped and averaged ones differ by this, and by as many standard
# errors.
_MIN_PLACEMENT, _DEVIATIONS = math.log1p(0.015), 4.0

# By model, old release and new release.
Counts = Mapping[tuple[str, str, str], ExplainRecord]


@dataclass(frozen=True)
class SpeedHistory:
    """The time of a step over the releases, and what is known of its changes.

    Attributes:
      models: the history of each.
      counts: of instructions by function, of neighbouring releases.
      changelog: of MuJoCo; None where no installed package carries it.
      since: the first release whose changes are listed; None for all.
    """

    models: Sequence[ModelHistory]
    counts: Counts
    changelog: Changelog | None
    since: str | None = None

    def lists(self, model: ModelHistory, index: int) -> bool:
        """Return whether a change of a model at an index is listed."""
        release = model.measured[index].release
        return self.since is None or version_key(release) >= version_key(self.since)


def from_records(
    records: Sequence[object],
    versions: Sequence[str],
    changelog: Changelog | None = None,
    since: str | None = None,
) -> SpeedHistory:
    """Return the history that records of run files hold.

    Args:
      records: of `history measure` and `history explain`; others are left out.
      versions: of all releases, in the order of their upload.
      changelog: of MuJoCo; None where no installed package carries it.
      since: the first release whose changes are listed; None for all.
    """
    ratios = [record for record in records if isinstance(record, StepRatioRecord)]
    counts = {(r.model, r.old, r.new): r for r in records if isinstance(r, ExplainRecord)}
    return SpeedHistory(speed_history.histories(ratios, versions), counts, changelog, since)


def lines(history: SpeedHistory) -> Iterator[str]:
    """Yield the sections of a page on the time of a step, in Markdown."""
    listed = listed_changes(history)
    yield from conclusion(history.models, listed)
    yield "\n## Change points\n"
    yield (
        "Changes of the time of a step from one release to the next, from 1 % on, with their"
        " standard error. The cause is `work` where a step has other work to do, `code` where the"
        " same work takes another time with placement averaged out, and `undecided` where that is"
        " not known. Behind a function stands by how many percent of the"
        " step its instructions changed.\n"
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


@dataclass(frozen=True)
class Listed:
    """A change point, and what is known of it.

    Attributes:
      model: history of the model.
      point: the change of its time.
      before: the last release before it.
      after: the first release with it.
      counts: of instructions by function, in these two; None where they were not counted.
    """

    model: ModelHistory
    point: ChangePoint
    before: Measured
    after: Measured
    counts: ExplainRecord | None

    @property
    def work_changes(self) -> list[str]:
        """How the work changed; empty where it is the same."""
        return speed_history.work_changes(self.before, self.after)

    @property
    def cause(self) -> Cause:
        """Whether the time changed with the work or with the code that does it, if it is known."""
        records = self.before.record, self.after.record
        if any(record.problem or record.work is None for record in records):
            return Cause.UNDECIDED
        return Cause.WORK if self.work_changes else Cause.CODE


def listed_changes(history: SpeedHistory) -> list[Listed]:
    """Return the change points of all models: by release, and of one release the largest first."""
    counts = history.counts
    listed = [
        Listed(
            model, point, before, after, counts.get((model.model, before.release, after.release))
        )
        for model in history.models
        for point in model.changes.change_points
        if history.lists(model, point.index)
        for before, after in [model.pair(point.index, point.before)]
    ]
    return sorted(listed, key=lambda c: (version_key(c.after.release), -abs(c.point.change)))


def _pair_key(model: ModelHistory, before: Measured, after: Measured) -> tuple[str, str, str]:
    return model.model, before.release, after.release


def conclusion(models: Sequence[ModelHistory], listed: Sequence[Listed]) -> Iterator[str]:
    """Yield sentences: from the first release to the last, and the largest changes."""
    totals = [_total(model) for model in models if len(model.measured) > 1]
    slower = [total for total in totals if total >= MIN_CHANGE]
    faster = [total for total in totals if total <= -MIN_CHANGE]
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
        features = [phrase.split()[0] for phrase in listed.work_changes if "→" in phrase]
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
        if history.lists(model, excursion.index)
        for before, after in [model.pair(excursion.index)]
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
        if history.lists(model, drift.end - 1)
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
        if history.lists(model, index)
        for before, after in [model.pair(index)]
        for averaged in [after.ratio.log_ratio - before.ratio.log_ratio]
        if (shipped := _shipped_change(before, after, averaged)) is not None
    ]
    if not rows:
        return iter(["None."])
    headings = ["release", "model", "as shipped", "averaged"]
    return table(headings, rows, right_aligned=("as shipped", "averaged"))


def _shipped_change(before: Measured, after: Measured, averaged: float) -> float | None:
    """Return the change as shipped where placement certainly adds to it; None otherwise."""
    old, new = (step_ratios.as_shipped(each.record.launches) for each in (before, after))
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
            _change(_total(model)),
            str(len(model.changes.change_points)),
            _work(first, last),
        )
        for model in models
        if len(model.measured) > 1
        for first, last in [(model.measured[0], model.measured[-1])]
    ]
    headings = ["model", "first", "last", "time", "change points", "work"]
    return table(headings, rows, right_aligned=("time", "change points"))


def _change(log_ratio: float) -> str:
    """Return a log ratio as a change in percent, or as a factor (see `markdown.change`)."""
    return change(math.exp(log_ratio))


def _total(model: ModelHistory) -> float:
    return model.measured[-1].ratio.log_ratio - model.measured[0].ratio.log_ratio


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
