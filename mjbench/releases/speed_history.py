"""The speed of models over the releases, and what changed it: from ratios to one fixed release."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from mjbench.releases import change_points, release_ratios
from mjbench.releases.change_points import Changes
from mjbench.releases.release import version_key
from mjbench.releases.release_ratios import Ratio, StepRatioRecord
from mjbench.simulation import agreement
from mjbench.status import Status


@dataclass(frozen=True)
class Measured:
    """A model in one release.

    Attributes:
      release: of MuJoCo.
      ratio: time of a step over that of the reference.
      record: that it is from.
    """

    release: str
    ratio: Ratio
    record: StepRatioRecord


@dataclass(frozen=True)
class ModelHistory:
    """A model over the releases.

    Attributes:
      model: its name.
      measured: the releases in which it was measured, in the order of their upload.
      changes: of its speed; indices are those of `measured`.
    """

    model: str
    measured: Sequence[Measured]
    changes: Changes

    def pair(self, index: int, before: int | None = None) -> tuple[Measured, Measured]:
        """Return the release at an index, and one before it: the last one, or that at `before`."""
        return self.measured[index - 1 if before is None else before], self.measured[index]


def histories(records: Iterable[StepRatioRecord], versions: Sequence[str]) -> list[ModelHistory]:
    """Return the history of each model, by name.

    The launches of several records of a model and a release add up where they are of one build and
    one workload; otherwise the last record counts. Records that failed are left out.

    Args:
      records: of any releases, in the order they were measured.
      versions: of the releases of the git history, in the order of their upload. Others, such as
        wheels of one's own, follow by their version.
    """
    by_model: dict[str, dict[str, Measured]] = {}
    for record in records:
        if record.status != Status.OK:
            continue
        of_release = by_model.setdefault(record.model, {})
        earlier = of_release.get(record.release)
        pooled = _pooled(earlier.record, record) if earlier else record
        ratio = release_ratios.averaged(pooled.launches)
        if ratio is not None:
            of_release[record.release] = Measured(record.release, ratio, pooled)
    measured_versions = {version for of_release in by_model.values() for version in of_release}
    others = sorted(measured_versions - {*versions}, key=lambda v: (version_key(v), v))
    return [
        _history(model, [of_release[v] for v in (*versions, *others) if v in of_release])
        for model, of_release in sorted(by_model.items())
        if of_release
    ]


def _pooled(earlier: StepRatioRecord, later: StepRatioRecord) -> StepRatioRecord:
    """Return a record with the launches of both, or the later one where they cannot be pooled."""
    same = all(
        getattr(earlier, name) == getattr(later, name)
        for name in ("build", "reference", "workload", "problem")
    )
    return replace(later, launches=[*earlier.launches, *later.launches]) if same else later


def _history(model: str, measured: Sequence[Measured]) -> ModelHistory:
    log_ratios = [each.ratio.log_ratio for each in measured]
    deviations = [each.ratio.deviation for each in measured]
    return ModelHistory(model, measured, change_points.changes(log_ratios, deviations))


def change(before: Measured, after: Measured) -> Ratio:
    """Return the time of a step in one release over that in another, with its standard error."""
    old, new = before.ratio, after.ratio
    deviation = math.hypot(old.deviation, new.deviation)
    return Ratio(new.log_ratio - old.log_ratio, deviation)


def changed_counters(before: Measured, after: Measured) -> list[str]:
    """Return the names of the counters of work that changed; none where they are not known."""
    old, new = before.record, after.record
    if old.workload != new.workload or old.work is None or new.work is None:
        return []
    return agreement.changed_counters(old.work.as_dict(), new.work.as_dict())


def work_changes(before: Measured, after: Measured) -> list[str]:
    """Describe how the work of a step changed from one release to another.

    Returns:
      Phrases such as `contacts 1 → 5`, the counters first, and then whether one step gives another
      result. For that the drifts of both releases from the reference are compared: where they
      differ, one of the two computes something else.
    """
    old, new = before.record, after.record
    if old.workload != new.workload or old.work is None or new.work is None:
        return ["another workload"]
    changes = agreement.counter_changes(old.work.as_dict(), new.work.as_dict())
    return changes + agreement.result_changes(old.drift, new.drift)
