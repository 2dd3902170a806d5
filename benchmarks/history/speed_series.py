"""The speed of models and operations over the releases: from ratios to one fixed release."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from packaging.version import InvalidVersion, Version

from benchmarks.history import change_points, release_ratios
from benchmarks.history.change_points import Changes
from benchmarks.history.log_estimates import LogEstimate
from benchmarks.history.release_ratios import RatioRecord, StepRatioRecord
from mjbench.releases.release import version_key
from mjbench.simulation import changed_work
from mjbench.simulation.reference_run import Work
from mjbench.status import Status

# The smallest relative difference of two drifts that says that a step's result changed.
_DRIFT_CHANGE = 1e-3


@dataclass(frozen=True)
class NoChangePair:
    """Two releases, one uploaded after the other, whose steps execute equally many instructions.

    A verdict between them must be `same`: they are the negative controls for whatever claims to
    tell a change of code from a change of its placement in memory.
    """

    old: str
    new: str


# The releases of each pair execute equally many instructions per step on every shipped model, as
# counted by `mjbench profile --instructions`. Their libraries differ nevertheless: code lies
# elsewhere, and instructions hold other displacements where a struct grew. In the last pair five
# functions that the cloth executes use other registers, too (`mjbench versions --explain 3.3.1
# 3.3.2 cloth`).
NO_CHANGE_PAIRS = (
    NoChangePair("3.1.2", "3.1.3"),
    NoChangePair("3.2.0", "3.2.1"),
    NoChangePair("3.2.1", "3.2.2"),
    NoChangePair("3.3.1", "3.3.2"),
)


@dataclass(frozen=True)
class MeasuredRelease:
    """A model or an operation in one release; its ratio is to the reference."""

    release: str
    ratio: LogEstimate
    record: RatioRecord

    @property
    def step_work(self) -> Work | None:
        return self.record.work if isinstance(self.record, StepRatioRecord) else None


@dataclass(frozen=True)
class SpeedSeries:
    """A model or an operation in one or more releases, in the order of their versions.

    Indices of `changes` are those of `measured`.
    """

    name: str
    measured: Sequence[MeasuredRelease]
    changes: Changes

    def pair(
        self, index: int, before: int | None = None
    ) -> tuple[MeasuredRelease, MeasuredRelease]:
        """Return the release at an index, and one before it: the last one, or that at `before`."""
        return self.measured[index - 1 if before is None else before], self.measured[index]


def in_order(versions: Iterable[str]) -> list[str]:
    return sorted(versions, key=order)


def in_order_of_release(records: Iterable[RatioRecord]) -> list[RatioRecord]:
    return sorted(records, key=lambda record: order(record.release))


def order(version: str) -> tuple[Version, str]:
    try:
        return Version(version), version
    except InvalidVersion:  # a wheel of one's own may have any
        return Version(".".join(map(str, version_key(version))) or "0"), version


def histories(records: Iterable[RatioRecord]) -> list[SpeedSeries]:
    """Return the series of each model and each operation, in the order of their first records.

    The launches of several records of one release add up where they are of one build and
    one workload; otherwise the last record counts. Records that failed are left out.
    """
    by_series: dict[str, dict[str, MeasuredRelease]] = {}
    for record in records:
        if record.status != Status.OK:
            continue
        of_release = by_series.setdefault(record.series, {})
        earlier = of_release.get(record.release)
        pooled = _pooled(earlier.record, record) if earlier else record
        ratio = release_ratios.averaged(pooled.launches)
        if ratio is not None:
            of_release[record.release] = MeasuredRelease(record.release, ratio, pooled)
    return [
        _series(name, [of_release[version] for version in in_order(of_release)])
        for name, of_release in by_series.items()
        if of_release
    ]


def _pooled(earlier: RatioRecord, later: RatioRecord) -> RatioRecord:
    """Return a record with the launches of both, or the later one where they cannot be pooled."""
    is_same = all(
        getattr(earlier, name, None) == getattr(later, name, None)
        for name in ("build", "reference", "problem", "workload")  # which operations do not have
    )
    return replace(later, launches=[*earlier.launches, *later.launches]) if is_same else later


def _series(name: str, measured: Sequence[MeasuredRelease]) -> SpeedSeries:
    log_ratios = [each.ratio.log_ratio for each in measured]
    deviations = [each.ratio.deviation for each in measured]
    return SpeedSeries(name, measured, change_points.changes(log_ratios, deviations))


def change(before: MeasuredRelease, after: MeasuredRelease) -> LogEstimate:
    old, new = before.ratio, after.ratio
    deviation = math.hypot(old.deviation, new.deviation)
    return LogEstimate(new.log_ratio - old.log_ratio, deviation)


def knows_work(before: MeasuredRelease, after: MeasuredRelease) -> bool:
    old, new = before.record, after.record
    if isinstance(old, StepRatioRecord) and isinstance(new, StepRatioRecord):
        return old.work is not None and new.work is not None and old.workload == new.workload
    return old.drift is not None and new.drift is not None


def work_changes(before: MeasuredRelease, after: MeasuredRelease) -> list[str]:
    """Describe how the work changed from one release to another; empty where it did not.

    Of steps the counters come first, such as `contacts 1 → 5`; then whether the result is another
    one. For that the drifts of both releases from the reference are compared: where they differ,
    one of the two computes something else. Nothing is said of what is not known.
    """
    old, new = before.record, after.record
    if not (isinstance(old, StepRatioRecord) and isinstance(new, StepRatioRecord)):
        return ["another result"] if _result_changes(old.drift, new.drift) else []
    changes = []
    if knows_work(before, after) and old.work is not None and new.work is not None:
        changes += changed_work.counter_changes(old.work.as_dict(), new.work.as_dict())
        changes += _result_changes(old.drift, new.drift)
    if old.diverged != new.diverged:  # each is then timed with other simulations
        changes.append(f"{new.diverged} simulations diverge instead of {old.diverged}")
    return changes


def _result_changes(before: float | None, after: float | None) -> list[str]:
    """Return, in a phrase, that releases with these drifts differ; empty if they do not."""
    if before is None or after is None:
        return []
    low, high = sorted((before, after))
    is_other = high > changed_work.ROUNDING and high - low > _DRIFT_CHANGE * high
    return ["different result of one step"] if is_other else []
