"""Decide whether a function is slower in one revision of the user's code, or in one environment.

Before anything is timed, the code must be that of the two sides, and results must be the same. A
control is measured beside the verdict: the baseline against itself, in as many launches as a
verdict needs at least. Where the baseline differs from itself, nothing is decided.
"""

import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from mjbench.commands.versions.function_sides import (
    FunctionTarget,
    FunctionTargets,
    OtherCodeError,
    check_origin,
    check_versions,
)
from mjbench.errors import Failure, InputError, MachineError, UnavailableError
from mjbench.host import machine
from mjbench.measuring import launch_stats
from mjbench.measuring.calls import Compilation
from mjbench.paired.call_results import ResultsDifference, compare
from mjbench.paired.launches import launch
from mjbench.paired.metrics import METRICS, Metric
from mjbench.paired.outcomes import ResultsOutcome, Verdict
from mjbench.paired.pair_launches import CountRule, PairTargets, ProcessPair
from mjbench.paired.records import (
    CompilationFigures,
    ControlRow,
    Judgement,
    LaunchRow,
    Pair,
    VerdictRecord,
)
from mjbench.paired.time_limit import ENDING_ERRORS, TimeLimit, ending_of
from mjbench.paired.timed_function import (
    FunctionFacts,
    compilation_of,
    import_function,
    prepare_function,
    try_function,
)
from mjbench.paired.verdict import MIN_LAUNCHES, VerdictPlan, launch_until_certain, package_versions
from mjbench.paired.worker_pool import WorkerPool, WorkerProcess
from mjbench.releases.pip import BuildError
from mjbench.status import Status

# A function that keeps more cores busy than this has threads, and launches get all cores.
_THREADED_CORES = 1.2


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
        both_s = count * sum(each.call_s for each in facts)
        return cls(count, both_s, machine.usable_cores() if is_threaded else 1, metric)


class FunctionPair(PairTargets):
    """A function in a baseline and in a candidate, whose calls are timed."""

    def __init__(
        self, pool: WorkerPool, targets: FunctionTargets, plan: CallPlan, time_limit: TimeLimit
    ):
        baseline, candidate = targets
        names = baseline.name("baseline"), candidate.name("candidate")
        releases = baseline.release, candidate.release
        super().__init__(pool, releases, names, plan.metric, time_limit)
        self._targets, self._plan, self.nthread = targets, plan, plan.nthread

    def fix_work(self) -> None:
        self._time_limit.start()
        self._time_limit.check_first_launch(self.launch_s(self._plan.both_s))

    def equip(self, processes: Sequence[WorkerProcess]) -> None:
        # what a function does only once is of no interest, unless it compiles
        calls_it = not self._metric.compiles
        for process, target in zip(processes, self._targets, strict=True):
            process.ask(import_function, target.source, calls_it=calls_it)

    def compilations(self, pair: ProcessPair) -> Pair[Compilation] | None:
        if self._targets[0].run is None:
            return None
        baseline, candidate = (process.call(compilation_of) for process in pair.processes)
        return Pair(baseline, candidate) if baseline and candidate else None

    def _prepare_blocks(self, process: WorkerProcess, i: int, allowed: Sequence[int]) -> int:
        return process.call(prepare_function, allowed, self._plan.count, self._plan.metric)


def control_row(launches: Sequence[LaunchRow], confidence: float) -> ControlRow | None:
    """Return what launches of the baseline against itself show; None without any."""
    if not launches:
        return None
    log_ratios = [launch.log_ratio for launch in launches]
    interval = launch_stats.evidence(log_ratios, confidence).interval
    return ControlRow(interval.exponential, len(launches), interval.covers(0))


def _code(target: FunctionTarget) -> tuple[str, str]:
    """Return what is the same on two sides where both run the same code."""
    return target.tree, target.release.key


def compare_results(
    baseline: FunctionFacts, again: FunctionFacts, candidate: FunctionFacts
) -> ResultsDifference:
    """Return how results compare; `again` is of the baseline, and shows whether its are random."""
    for facts in (baseline, candidate):
        if facts.problem:
            return ResultsDifference(ResultsOutcome.NONE, facts.problem)
    own = compare(baseline.results, again.results)
    if own.outcome == ResultsOutcome.DIFFERENT:
        return ResultsDifference(ResultsOutcome.RANDOM, f"of the baseline alone, {own.detail}")
    return compare(baseline.results, candidate.results)


@dataclass(frozen=True)
class _Observed:
    """What is known before anything is timed."""

    baseline: FunctionFacts
    candidate: FunctionFacts
    results: ResultsDifference


class _NewError(Exception):
    """The candidate can do it, and the baseline cannot."""


def observe(pool: WorkerPool, target: FunctionTarget, role: str) -> FunctionFacts:
    with pool.ready(target.release, target.name(role)) as process:
        process.call(import_function, target.source)
        return process.call(try_function, target.origin)


def _observe(pool: WorkerPool, targets: FunctionTargets) -> _Observed:
    """See what both sides do; raises _NewError where only the candidate can do it."""
    baseline, candidate = targets
    try:
        old = observe(pool, baseline, "baseline")
    except InputError as error:
        try:
            new = observe(pool, candidate, "candidate")
        except UnavailableError as neither:
            raise InputError(str(neither)) from neither
        check_origin(candidate, "candidate", new)
        raise _NewError(f"new, so not compared: {error}") from error
    check_origin(baseline, "baseline", old)
    try:
        new = observe(pool, candidate, "candidate")
    except UnavailableError as error:
        raise MachineError(str(error)) from error
    check_origin(candidate, "candidate", new)
    if candidate.revision is not None:  # the versions of packages are to differ otherwise
        check_versions(old, new)
    again = observe(pool, baseline, "baseline") if any(old.results) else old
    return _Observed(old, new, compare_results(old, again, new))


@dataclass
class _Decision:
    pool: WorkerPool
    targets: FunctionTargets
    plan: VerdictPlan
    on_launch: Callable[[Judgement], None]
    clock: Callable[[], float]
    observed: _Observed | None = None
    control: Sequence[LaunchRow] = ()
    launches: Sequence[LaunchRow] = ()

    def __post_init__(self) -> None:
        self.begin_s = self.clock()

    def run(self) -> VerdictRecord:
        baseline, candidate = self.targets
        if _code(baseline) == _code(candidate):
            try:
                observe(self.pool, baseline, "baseline")
            except ENDING_ERRORS as error:
                failure = ending_of(error)
                is_missing = failure.status == Status.UNAVAILABLE
                return self._record(
                    replace(failure, status=Status.INPUT) if is_missing else failure
                )
            same = "revisions have the same files" if baseline.revision else "environments are one"
            detail = f"both {same}, so nothing was timed"
            return self._record(Failure(Status.OK, detail), Verdict.SAME)
        try:
            self.observed = _observe(self.pool, self.targets)
        except (OtherCodeError, BuildError):  # of all functions
            raise
        except _NewError as error:
            return self._record(Failure(Status.NEW, str(error)))
        except ENDING_ERRORS as error:
            return self._record(ending_of(error))
        results = self.observed.results
        if results.outcome == ResultsOutcome.DIFFERENT:
            detail = f"results differ: {results.detail}; no verdict on speed"
            return self._record(Failure(Status.DISAGREES, detail))
        facts = self.observed.baseline, self.observed.candidate
        return self._timed(CallPlan.of(facts, self.plan.sizes.metric))

    def _timed(self, calls: CallPlan) -> VerdictRecord:
        """Launch the control, then both sides, until the verdict is certain or time is up."""
        baseline, now_s = self.targets[0], self.clock()
        end_s = self.plan.time_limit_s + (self.begin_s if self.plan.counts_loading else now_s)
        # half of the time for half of the launches
        limit = self._limit((end_s - now_s) / 2)
        control = CountRule(limit, MIN_LAUNCHES)
        pair = FunctionPair(self.pool, (baseline, baseline), calls, limit)
        ending, judgement = launch(pair, control), None
        self.control = control.launches
        # a budget is for both, and what ended the control ends the verdict
        if ending.status == Status.OK and control.has_enough:
            limit = self._limit(end_s - self.clock())
            pair = FunctionPair(self.pool, self.targets, calls, limit)
            rule, ending = launch_until_certain(pair, self.plan, limit, self.on_launch)
            self.launches, judgement = rule.launches, rule.judgement
        return self._record(ending, judgement=judgement)

    def _limit(self, seconds: float) -> TimeLimit:
        purpose, counts_loading = "a verdict with its control", self.plan.counts_loading
        return TimeLimit(seconds, 2 * MIN_LAUNCHES, self.clock, purpose, counts_loading)

    def _compiling(self, observed: _Observed) -> Pair[CompilationFigures] | None:
        first = observed.baseline.compilation, observed.candidate.compilation
        if first[0] is None or first[1] is None:
            return None
        launched = [each.compilations for each in self.launches if each.compilations]
        is_timed = METRICS[self.plan.sizes.metric].is_of_steps
        runs_s = [launch.block_s for launch in self.launches] if is_timed else []
        return Pair(
            CompilationFigures.of([first[0], *(e.old for e in launched)], [s.old for s in runs_s]),
            CompilationFigures.of([first[1], *(e.new for e in launched)], [s.new for s in runs_s]),
        )

    def _record(
        self,
        ending: Failure,
        verdict: Verdict = Verdict.INCONCLUSIVE,
        judgement: Judgement | None = None,
    ) -> VerdictRecord:
        """Return the verdict as a run file stores it; `verdict` is that without any launch."""
        baseline, candidate = self.targets
        observed, launches, run = self.observed, self.launches, candidate.run
        record = VerdictRecord.of(
            (baseline.row(), candidate.row()),
            self.plan.sizes.metric,
            ending,
            judgement,
            results=observed.results if observed else None,
            launches=launches,
            seconds=self.clock() - self.begin_s,
        )
        detail, control = ending.detail, control_row(self.control, self.plan.confidence)
        verdict = judgement.verdict if judgement else verdict
        is_ok = ending.status == Status.OK
        if is_ok and control is not None and not control.covers:
            verdict, detail = Verdict.INCONCLUSIVE, detail or "the baseline differs from itself"
        is_timed = bool(launches) and METRICS[record.metric].is_of_steps
        return replace(
            record,
            verdict=verdict if is_ok else None,
            detail=detail,
            nbatch=run.nbatch if run else None,
            nstep=run.nstep if run else None,
            starts=run.starts if run else None,
            control=control,
            calls_s=Pair(observed.baseline.call_s, observed.candidate.call_s) if observed else None,
            slowing=statistics.median(each.slowing for each in launches) if is_timed else None,
            packages=package_versions(baseline.release, candidate.release),
            compiling=self._compiling(observed) if observed else None,
        )


def decide_function(
    pool: WorkerPool,
    targets: FunctionTargets,
    plan: VerdictPlan,
    on_launch: Callable[[Judgement], None] = lambda judgement: None,
    clock: Callable[[], float] = time.monotonic,
) -> VerdictRecord:
    """Compare a function on two sides until the verdict is certain, or time is up.

    Raises:
      OtherCodeError: the code that would be measured is not that of its side.
      BuildError: what a side needs cannot be installed.
    """
    return _Decision(pool, targets, plan, on_launch, clock).run()
