"""Search the releases of MuJoCo for those that changed how long the steps of a model take."""

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace

from benchmarks.history import known_causes
from mjbench.errors import MachineError
from mjbench.paired import bisect_search, verdict
from mjbench.paired.bisect_records import (
    BisectChange,
    BisectMeasured,
    BisectRecord,
    VersionKind,
    VersionRow,
)
from mjbench.paired.bisect_search import SearchRange, VersionMeasurer
from mjbench.paired.records import VerdictRecord
from mjbench.paired.targets import Target
from mjbench.paired.verdict import VerdictPlan
from mjbench.paired.worker_pool import WorkerPool
from mjbench.releases import installs
from mjbench.releases.catalogue import ReleaseRange
from mjbench.releases.release_names import INSTALLED
from mjbench.simulation import models
from mjbench.simulation.models import ModelSource
from mjbench.status import Status
from mjbench.store.runs import Record


@dataclass(frozen=True)
class _ReleaseMeasurer(VersionMeasurer):
    """Measures releases of MuJoCo."""

    pool: WorkerPool
    releases: ReleaseRange
    source: ModelSource
    plan: VerdictPlan
    on_phase: Callable[[str], None]

    def decide(self, baseline: int, candidate: int) -> VerdictRecord:
        """See `VersionMeasurer.decide`; raises KeyboardInterrupt, too."""
        old, new = self._target(baseline), self._target(candidate)
        self.on_phase(f"comparing {old.release.version} and {new.release.version}")
        result = verdict.decide(self.pool, old, new, self.plan)
        if result.status == Status.INTERRUPTED:
            raise KeyboardInterrupt
        return result.record()

    def log_ratios(self, baseline: int, candidate: int, count: int) -> Sequence[float]:
        problem = self.releases.index_problem
        if problem and candidate not in self.ready():
            raise MachineError(f"not installed here, and {problem}")
        old, new = self._target(baseline), self._target(candidate)
        return verdict.launch_log_ratios(self.pool, old, new, self.plan, count)

    def ready(self) -> Collection[int]:
        names = installs.install_names()
        return {
            number
            for number, release in enumerate(self.releases.specs)
            if release.name == INSTALLED or release.key in names
        }

    def _target(self, number: int) -> Target:
        return Target(self.releases.specs[number], self.source)


def search(
    releases: ReleaseRange,
    source: ModelSource,
    plan: VerdictPlan,
    on_phase: Callable[[str], None] = lambda text: None,
    earlier: Sequence[Record] = (),
) -> Iterator[BisectMeasured]:
    """Yield what is measured, and which releases changed the time of a model's steps."""
    baseline, *candidates = releases.specs
    searched = SearchRange(
        source.name,
        VersionKind.RELEASE,
        baseline.version,
        candidates[-1].version,
        [VersionRow(number, each.version) for number, each in enumerate(candidates, 1)],
    )
    with WorkerPool() as pool:
        measurer = _ReleaseMeasurer(pool, releases, source, plan, on_phase)
        for record in bisect_search.search(measurer, searched, plan.min_effect, earlier):
            if isinstance(record, BisectRecord):
                changes = [_with_causes(change, source) for change in record.changes]
                yield replace(record, changes=changes)
            else:
                yield record


def _with_causes(change: BisectChange, source: ModelSource) -> BisectChange:
    """Return a change with what is known of it: of shipped models, in a checkout of mjbench."""
    file = known_causes.default_path()
    if source.name not in models.shipped() or file is None:
        return change
    known = known_causes.explaining(change.version.name, source.name, known_causes.load(file))
    return replace(change, known_causes=[cause.text for cause in known])
