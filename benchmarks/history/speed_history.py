"""What happened to speed over the releases, and why: what a page says of it.

All of it comes from ratios to one fixed release (`measure`), from counts by function (`explain`),
and from a table of causes that no measurement names.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from benchmarks.history import known_causes, speed_series
from benchmarks.history.change_points import ChangePoint
from benchmarks.history.known_causes import KnownCause
from benchmarks.history.release_ratios import OperationRatioRecord, RatioRecord
from benchmarks.history.speed_series import MeasuredRelease, SpeedSeries, order
from mjbench.counts.records import ExplainRecord
from mjbench.host.machine import Machine
from mjbench.paired.outcomes import Cause

# By model or operation, old release and new release.
Counts = Mapping[tuple[str, str, str], ExplainRecord]


@dataclass(frozen=True)
class SpeedHistory:
    """The speed of MuJoCo over the releases, and what is known of its changes.

    Attributes:
      operations: around the step.
      counts: of instructions by function, of neighbouring releases, on any machine.
      causes: that no measurement names.
      operations_machine: that operations were measured on, if it is another one.
    """

    models: Sequence[SpeedSeries]
    operations: Sequence[SpeedSeries] = ()
    counts: Counts = field(default_factory=dict)
    causes: Sequence[KnownCause] = ()
    machine: Machine | None = None
    operations_machine: Machine | None = None

    def instructions(self, model: str) -> dict[str, float]:
        """Return the instructions of a step of a model, by release, where they were counted."""
        counts: dict[str, float] = {}
        for (counted, old, new), record in self.counts.items():
            per_step = record.instructions_per_step
            if counted == model and per_step.old and per_step.new:
                counts.setdefault(old, per_step.old)
                counts[new] = per_step.new
        return counts

    @property
    def all_series(self) -> Sequence[SpeedSeries]:
        return [*self.models, *self.operations]

    def releases(self) -> list[str]:
        releases = {each.release for series in self.all_series for each in series.measured}
        return speed_series.in_order(releases)


def from_records(
    records: Sequence[object],
    causes: Sequence[KnownCause] = (),
    machine: Machine | None = None,
    operations_machine: Machine | None = None,
) -> SpeedHistory:
    """Return the history that records of run files hold; see `SpeedHistory` for what they lack.

    Args:
      records: of `measure` and `explain`; others are left out.
    """
    ratios = [record for record in records if isinstance(record, RatioRecord)]
    counts = {(r.series, r.old, r.new): r for r in records if isinstance(r, ExplainRecord)}
    models, operations = (
        speed_series.histories(
            r for r in ratios if isinstance(r, OperationRatioRecord) == is_operation
        )
        for is_operation in (False, True)
    )
    return SpeedHistory(models, operations, counts, causes, machine, operations_machine)


def title(record: RatioRecord) -> str:
    if not isinstance(record, OperationRatioRecord):
        return record.model
    return ", ".join(filter(None, (record.title, record.model)))


@dataclass(frozen=True)
class Listed:
    """A change point of a series, and what is known of it.

    Attributes:
      counts: of instructions by function, in these two.
    """

    series: SpeedSeries
    point: ChangePoint
    before: MeasuredRelease
    after: MeasuredRelease
    counts: ExplainRecord | None
    causes: Sequence[KnownCause] = ()

    @property
    def title(self) -> str:
        return title(self.after.record)

    @property
    def work_changes(self) -> list[str]:
        return speed_series.work_changes(self.before, self.after)

    @property
    def cause(self) -> Cause:
        """Whether the time changed with the work or with the code that does it, if it is known.

        It is not where placement was not averaged out, or where the work is not known.
        """
        if self.before.record.problem or self.after.record.problem:
            return Cause.UNDECIDED
        if self.work_changes:
            return Cause.WORK
        is_known = speed_series.knows_work(self.before, self.after)
        return Cause.CODE if is_known else Cause.UNDECIDED


def listed_changes(history: SpeedHistory, all_series: Sequence[SpeedSeries]) -> list[Listed]:
    """Return change points of models or operations: by release, and of one the largest first."""
    listed = [
        Listed(
            series,
            point,
            before,
            after,
            history.counts.get((series.name, before.release, after.release)),
            known_causes.explaining(after.release, series.name, history.causes),
        )
        for series in all_series
        for point in series.changes.change_points
        for before, after in [series.pair(point.index, point.before)]
    ]
    return sorted(listed, key=lambda c: (order(c.after.release), -abs(c.point.change)))
