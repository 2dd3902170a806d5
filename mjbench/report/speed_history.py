"""What docs/history.md says of the time of a step: steps, excursions, drifts, first to last.

All of it comes from ratios to one fixed release (`mjbench history measure`) and from counts by
function (`mjbench history explain`).
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from mjbench.counts.function_differences import largest_differences
from mjbench.counts.records import ExplainRecord
from mjbench.paired.outcomes import Cause
from mjbench.releases import speed_history, step_ratios
from mjbench.releases.change_points import MIN_CHANGE, Step
from mjbench.releases.changelog import Changelog
from mjbench.releases.release import version_key
from mjbench.releases.speed_history import Measured, ModelHistory
from mjbench.releases.step_ratios import StepRatioRecord
from mjbench.report.markdown import table

# As many functions are named of those that account for a change.
_MAIN_FUNCTIONS = 3
# As many characters are quoted of an item of the changelog.
_QUOTED = 160
# As shipped a change differs from the averaged one where it does by this, and by as many standard
# errors.
_MIN_PLACEMENT, _DEVIATIONS = math.log1p(0.015), 4.0

# By model, old release and new release.
Counts = Mapping[tuple[str, str, str], ExplainRecord]


@dataclass(frozen=True)
class StepHistory:
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


def step_history(
    records: Sequence[object],
    versions: Sequence[str],
    changelog: Changelog | None = None,
    since: str | None = None,
) -> StepHistory:
    """Return the history that records of run files hold.

    Args:
      records: of `history measure` and `history explain`; others are left out.
      versions: of all releases, in the order of their upload.
      changelog: of MuJoCo; None where no installed package carries it.
      since: the first release whose changes are listed; None for all.
    """
    ratios = [record for record in records if isinstance(record, StepRatioRecord)]
    counts = {(r.model, r.old, r.new): r for r in records if isinstance(r, ExplainRecord)}
    return StepHistory(speed_history.histories(ratios, versions), counts, changelog, since)


def lines(history: StepHistory) -> Iterator[str]:
    """Yield the sections of a page on the time of a step, in Markdown."""
    listed = listed_steps(history)
    yield from conclusion(history.models, listed)
    yield "\n## Steps\n"
    yield (
        "Changes of the time of a step from one release to the next, from 1 % on, with their"
        " standard error. The cause is `work` where a step has other work to do, and `code` where"
        " the same work takes another time. Behind a function stands by how many percent of the"
        " step its instructions changed.\n"
    )
    yield from steps_table(listed, history.changelog)
    yield "\n## Single releases that are off\n"
    yield "Changes that the next release takes back.\n"
    yield from excursions_table(history)
    yield "\n## Drifts\n"
    yield "Slow changes, of which no single one is a step.\n"
    yield from drifts_table(history)
    yield "\n## Only as shipped\n"
    yield (
        "Changes that disappear when the code is moved: they are due to its placement in memory."
        " Few launches are as shipped, so that only large changes are seen.\n"
    )
    yield from placement_table(history)
    yield "\n## From the first release to the last\n"
    yield from totals_table(history.models)


@dataclass(frozen=True)
class Listed:
    """A step, and what is known of it.

    Attributes:
      model: history of the model.
      step: of its time.
      before: the last release before it.
      after: the first release with it.
      counts: of instructions by function, in these two; None where they were not counted.
    """

    model: ModelHistory
    step: Step
    before: Measured
    after: Measured
    counts: ExplainRecord | None

    @property
    def work_changes(self) -> list[str]:
        """How the work changed; empty where it is the same."""
        return speed_history.work_changes(self.before, self.after)

    @property
    def cause(self) -> Cause:
        """Whether the time changed with the work, or with the code that does it."""
        return Cause.WORK if self.work_changes else Cause.CODE


def listed_steps(history: StepHistory) -> list[Listed]:
    """Return the steps of all models: by release, and of one release the largest first."""
    counts = history.counts
    steps = [
        Listed(model, step, before, after, counts.get((model.model, before.release, after.release)))
        for model in history.models
        for step in model.changes.steps
        if history.lists(model, step.index)
        for before, after in [model.pair(step.index, step.before)]
    ]
    return sorted(steps, key=lambda s: (version_key(s.after.release), -abs(s.step.change)))


def conclusion(models: Sequence[ModelHistory], steps: Sequence[Listed]) -> Iterator[str]:
    """Yield sentences: what happened from the first release to the last, and the largest steps."""
    totals = [_total(model) for model in models if len(model.measured) > 1]
    slower = [total for total in totals if total >= MIN_CHANGE]
    faster = [total for total in totals if total <= -MIN_CHANGE]
    yield (
        f"From the first release measured to the last, a step became slower for {len(slower)} of"
        f" {len(totals)} models{_range(slower)}, and faster for {len(faster)}{_range(faster)}."
    )
    largest = sorted(steps, key=lambda s: -abs(s.step.change))[:_MAIN_FUNCTIONS]
    if largest:
        texts = [
            f"{change(s.step.change)} for `{s.model.model}` in {s.after.release}" for s in largest
        ]
        yield f"The largest steps are {', '.join(texts)}."


def steps_table(steps: Sequence[Listed], changelog: Changelog | None) -> Iterator[str]:
    """Yield a Markdown table of steps, or that there are none."""
    if not steps:
        return iter([f"None from {100 * math.expm1(MIN_CHANGE):.0f} % on."])
    headings = ["releases", "model", "time", "instructions", "cause", "what accounts for it"]
    rows = (_step_row(step, changelog) for step in steps)
    return table(headings, rows, right_aligned=("time", "instructions"))


def _step_row(listed: Listed, changelog: Changelog | None) -> Sequence[str]:
    return (
        f"{listed.before.release} → {listed.after.release}",
        f"`{listed.model.model}`",
        f"{change(listed.step.change)} ±{100 * listed.step.deviation:.1f}",
        _instructions(listed.counts),
        str(listed.cause),
        "<br>".join(_accounts(listed, changelog)),
    )


def _accounts(listed: Listed, changelog: Changelog | None) -> Iterator[str]:
    """Yield what accounts for a step: work, functions, and an item of the changelog."""
    if listed.work_changes:
        yield "; ".join(listed.work_changes)
    functions = _functions(listed.counts)
    if functions:
        yield functions
    if changelog is not None and listed.counts is not None:
        names = [
            name
            for difference in largest_differences(listed.counts.functions, _MAIN_FUNCTIONS)
            for name in difference.names
        ]
        features = [phrase.split()[0] for phrase in listed.work_changes if "→" in phrase]
        item = changelog.fitting(listed.after.release, names, features)
        if item is not None:
            text = item.text.replace("|", "\\|")
            quoted = text if len(text) <= _QUOTED else f"{text[:_QUOTED]}…"
            commits = f" ({', '.join(f'`{c}`' for c in item.commits)})" if item.commits else ""
            yield f"changelog, perhaps: “{quoted}”{commits}"


def _functions(counts: ExplainRecord | None) -> str:
    """Return the functions that account for most of a difference, with their instructions."""
    if counts is None or not counts.instructions_per_step.old:
        return ""
    total = counts.instructions_per_step.old
    return ", ".join(
        f"`{' + '.join(d.names)}` {100 * d.difference / total:+.1f} %"
        for d in largest_differences(counts.functions, _MAIN_FUNCTIONS)
    )


def _instructions(counts: ExplainRecord | None) -> str:
    if counts is None:
        return ""
    old, new = counts.instructions_per_step.old, counts.instructions_per_step.new
    return f"{100 * (new / old - 1):+.1f} %" if old and new else ""


def excursions_table(history: StepHistory) -> Iterator[str]:
    """Yield a Markdown table of single releases that are off, or that there are none."""
    rows = [
        (after.release, f"`{model.model}`", change(excursion.change), _work(before, after))
        for model in history.models
        for excursion in model.changes.excursions
        if history.lists(model, excursion.index)
        for before, after in [model.pair(excursion.index)]
    ]
    if not rows:
        return iter(["None."])
    return table(["release", "model", "time", "work"], rows, right_aligned=("time",))


def drifts_table(history: StepHistory) -> Iterator[str]:
    """Yield a Markdown table of slow changes, or that there are none."""
    rows = [
        (
            f"{model.measured[drift.begin].release} to {model.measured[drift.end - 1].release}",
            f"`{model.model}`",
            change(drift.change),
        )
        for model in history.models
        for drift in model.changes.drifts
        if history.lists(model, drift.end - 1)
    ]
    if not rows:
        return iter(["None."])
    return table(["releases", "model", "time"], rows, right_aligned=("time",))


def placement_table(history: StepHistory) -> Iterator[str]:
    """Yield a Markdown table of changes that only the builds as shipped show."""
    rows = [
        (after.release, f"`{model.model}`", change(shipped), change(averaged))
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
            change(_total(model)),
            str(len(model.changes.steps)),
            _work(first, last),
        )
        for model in models
        if len(model.measured) > 1
        for first, last in [(model.measured[0], model.measured[-1])]
    ]
    headings = ["model", "first", "last", "time", "steps", "work"]
    return table(headings, rows, right_aligned=("time", "steps"))


def change(log_ratio: float) -> str:
    """Return a change in percent, or as a factor where it is at least twofold."""
    ratio = math.exp(log_ratio)
    return f"×{ratio:.2f}" if ratio >= 2 or ratio <= 0.5 else f"{100 * (ratio - 1):+.1f} %"


def _total(model: ModelHistory) -> float:
    return model.measured[-1].ratio.log_ratio - model.measured[0].ratio.log_ratio


def _range(log_ratios: Sequence[float]) -> str:
    """Return in brackets how large changes are, smallest to largest; empty without any."""
    if not log_ratios:
        return ""
    ordered = sorted(log_ratios, key=abs)
    if len(ordered) == 1:
        return f" ({change(ordered[0])})"
    return f" ({change(ordered[0])} to {change(ordered[-1])})"


def _work(before: Measured, after: Measured) -> str:
    return "; ".join(speed_history.work_changes(before, after)) or "the same"
