"""What happened to the time of a step over the releases, and why: what a page says of it.

All of it comes from ratios to one fixed release (`mjbench history measure`) and from counts by
function (`mjbench history explain`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from mjbench.counts.records import ExplainRecord
from mjbench.paired.outcomes import Cause
from mjbench.releases import speed_history
from mjbench.releases.change_points import ChangePoint
from mjbench.releases.changelog import Changelog
from mjbench.releases.release import version_key
from mjbench.releases.release_ratios import StepRatioRecord
from mjbench.releases.speed_history import Measured, ModelHistory

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

    def lists(self, release: str) -> bool:
        """Return whether changes that came with a release are listed."""
        return self.since is None or version_key(release) >= version_key(self.since)

    def instructions(self, model: str) -> dict[str, float]:
        """Return the instructions of a step of a model, by release, where they were counted."""
        counts: dict[str, float] = {}
        for (counted, old, new), record in self.counts.items():
            per_step = record.instructions_per_step
            if counted == model and per_step.old and per_step.new:
                counts.setdefault(old, per_step.old)
                counts[new] = per_step.new
        return counts

    def releases(self) -> list[str]:
        """Return the releases that any model was measured in, by version."""
        releases = {each.release for model in self.models for each in model.measured}
        return sorted(releases, key=lambda release: (version_key(release), release))


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
        for before, after in [model.pair(point.index, point.before)]
        if history.lists(after.release)
    ]
    return sorted(listed, key=lambda c: (version_key(c.after.release), -abs(c.point.change)))
