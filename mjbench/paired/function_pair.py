"""A function of the user's code on two sides, timed in turns in fresh processes."""

from collections.abc import Sequence
from dataclasses import dataclass

from mjbench.host import machine
from mjbench.measuring.calls import Compilation
from mjbench.paired.memory_blocks import GROWTH_NSTEP
from mjbench.paired.metrics import Metric
from mjbench.paired.pair_work import PairWork, check_growth
from mjbench.paired.process_pairs import ProcessPair
from mjbench.paired.protocol import LaunchedPair
from mjbench.paired.records import Pair, TargetRow
from mjbench.paired.time_limit import TimeLimit
from mjbench.paired.timed_function import (
    CodeOrigin,
    FunctionFacts,
    FunctionSource,
    compilation_of,
    import_function,
    prepare_function,
    try_function,
)
from mjbench.paired.worker_pool import WorkerPool
from mjbench.paired.worker_process import WorkerProcess
from mjbench.releases.installs import ReleaseSpec
from mjbench.releases.revisions import Revision
from mjbench.simulation.starts import Starts

# A function that keeps more cores busy than this has threads, and launches get all cores.
_THREADED_CORES = 1.2


@dataclass(frozen=True)
class SteppedRun:
    """What a function does that steps a model."""

    path: str
    nbatch: int
    nstep: int
    starts: Starts


@dataclass(frozen=True)
class FunctionTarget:
    """A function in one revision, or in one environment: a release with packages beside it.

    Attributes:
      tree: the hash of the revision's files; empty where environments are compared.
    """

    function: str
    revision: Revision | None
    tree: str
    source: FunctionSource
    origin: CodeOrigin
    release: ReleaseSpec
    run: SteppedRun | None = None

    @property
    def path(self) -> str:
        return self.run.path if self.run else ""

    def name(self, role: str) -> str:
        """Return what error messages call it in a role, such as `baseline (main)`."""
        return f"{role} ({self.label})"

    @property
    def label(self) -> str:
        return self.revision.name if self.revision else self.release.label

    def row(self) -> TargetRow:
        return TargetRow(
            release=self.release.version,
            model=self.function,
            path=self.path,
            options={},
            model_options={},
            build=self.release.key,
            revision=self.revision.name if self.revision else "",
            commit=self.revision.commit if self.revision else "",
            tree=self.tree,
            packages=self.release.name if self.release.has_packages else "",
        )


FunctionTargets = tuple[FunctionTarget, FunctionTarget]


def observe(pool: WorkerPool, target: FunctionTarget, role: str) -> FunctionFacts:
    process = pool.start(target.release, target.name(role))
    try:
        pool.wait_for(process, target.release)
        process.call(import_function, target.source)
        return process.call(try_function, target.origin)
    finally:
        pool.end([process])


@dataclass(frozen=True)
class CallPlan:
    """What each block of two sides does, and about how many seconds it takes of both together."""

    count: int
    both_s: float
    nthread: int
    metric: Metric = Metric.TIME

    @classmethod
    def of(cls, facts: Sequence[FunctionFacts], metric: Metric = Metric.TIME) -> "CallPlan":
        is_threaded = any(each.cores > _THREADED_CORES for each in facts)
        count = min(each.calls for each in facts)
        if metric == Metric.GROWTH:
            count = GROWTH_NSTEP
        both_s = count * sum(each.call_s for each in facts)
        return cls(count, both_s, machine.usable_cores() if is_threaded else 1, metric)


class _FunctionWork(PairWork):
    """The calls of two functions."""

    def __init__(self, targets: FunctionTargets, plan: CallPlan):
        super().__init__(plan.metric)
        self._targets, self._plan = targets, plan
        self.nthread = plan.nthread

    def equip(self, processes: Sequence[WorkerProcess]) -> None:
        # what a function does only once is of no interest, unless it compiles
        calls_it = self._metric != Metric.COMPILE
        for process, target in zip(processes, self._targets, strict=True):
            process.ask(import_function, target.source, calls_it=calls_it)

    def compilations(self, pair: ProcessPair) -> Pair[Compilation] | None:
        if self._targets[0].run is None:
            return None
        baseline, candidate = (process.call(compilation_of) for process in pair.processes)
        return Pair(baseline, candidate) if baseline and candidate else None

    def _prepare(self, process: WorkerProcess, i: int, allowed: Sequence[int]) -> int:
        return process.call(prepare_function, allowed, self._plan.count, self._metric)


class RevisionPair(LaunchedPair):
    """A function in a baseline and in a candidate."""

    def __init__(
        self, pool: WorkerPool, targets: FunctionTargets, plan: CallPlan, time_limit: TimeLimit
    ):
        baseline, candidate = targets
        names = baseline.name("baseline"), candidate.name("candidate")
        super().__init__(pool, (baseline.release, candidate.release), names, time_limit)
        self._targets, self._plan = targets, plan

    def _new_work(self) -> PairWork:
        self.time_limit.start()
        plan = self._plan
        if plan.metric == Metric.GROWTH:
            check_growth(plan.both_s, self._pool)
        work = _FunctionWork(self._targets, plan)
        self.time_limit.check_first_launch(work.launch_s(plan.both_s))
        return work
