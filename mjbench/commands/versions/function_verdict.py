"""Decide whether a function is slower in one revision of the user's code, or in one environment.

Before anything is timed, the code must be that of the two sides, and results must be the same. A
control is measured beside the verdict: the baseline against itself, in as many launches as a
verdict needs at least. Where the baseline differs from itself, nothing is decided.
"""

import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

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
from mjbench.measuring.ratio import Ratio
from mjbench.paired.call_results import ResultsCheck, compare
from mjbench.paired.metrics import METRICS, Measured, Metric
from mjbench.paired.outcomes import ResultsOutcome, Verdict
from mjbench.paired.pair_launches import LaunchedPair, PairWork, ProcessPair
from mjbench.paired.records import (
    MAX_E_VALUE,
    CompilationFigures,
    ControlRow,
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
from mjbench.paired.verdict import (
    MIN_LAUNCHES,
    Judgement,
    VerdictPlan,
    judge_launches,
    launch_until_certain,
    package_versions,
)
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


class _FunctionWork(PairWork):
    """The calls of two functions."""

    def __init__(self, targets: FunctionTargets, plan: CallPlan):
        super().__init__(plan.metric)
        self._targets, self._plan = targets, plan
        self.nthread = plan.nthread

    def equip(self, processes: Sequence[WorkerProcess]) -> None:
        # what a function does only once is of no interest, unless it compiles
        calls_it = METRICS[self._metric].measured != Measured.COMPILATION
        for process, target in zip(processes, self._targets, strict=True):
            process.ask(import_function, target.source, calls_it=calls_it)

    def compilations(self, pair: ProcessPair) -> Pair[Compilation] | None:
        if self._targets[0].run is None:
            return None
        baseline, candidate = (process.call(compilation_of) for process in pair.processes)
        return Pair(baseline, candidate) if baseline and candidate else None

    def _prepare(self, process: WorkerProcess, i: int, allowed: Sequence[int]) -> int:
        return process.call(prepare_function, allowed, self._plan.count, self._metric)


class FunctionPair(LaunchedPair):
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
        work = _FunctionWork(self._targets, plan)
        self.time_limit.check_first_launch(work.launch_s(plan.both_s))
        return work


def control_row(launches: Sequence[LaunchRow], confidence: float) -> ControlRow | None:
    """Return what launches of the baseline against itself show; None without any."""
    if not launches:
        return None
    log_ratios = [launch.log_ratio for launch in launches]
    interval = launch_stats.anytime_interval(log_ratios, confidence)
    ratio = Ratio.of_log(interval.mean, interval.half_width)
    return ControlRow(ratio, len(launches), interval.low <= 0 <= interval.high)


def _code(target: FunctionTarget) -> tuple[str, str]:
    """Return what is the same on two sides where both run the same code."""
    return target.tree, target.release.key


def compare_results(
    baseline: FunctionFacts, again: FunctionFacts, candidate: FunctionFacts
) -> ResultsCheck:
    """Return how results compare; `again` is of the baseline, and shows whether its are random."""
    for facts in (baseline, candidate):
        if facts.problem:
            return ResultsCheck(ResultsOutcome.NONE, facts.problem)
    own = compare(baseline.results, again.results)
    if own.outcome == ResultsOutcome.DIFFERENT:
        return ResultsCheck(ResultsOutcome.RANDOM, f"of the baseline alone, {own.detail}")
    return compare(baseline.results, candidate.results)


@dataclass(frozen=True)
class _Observed:
    """What is known before anything is timed."""

    baseline: FunctionFacts
    candidate: FunctionFacts
    results: ResultsCheck


class _NewError(Exception):
    """The candidate can do it, and the baseline cannot."""


def observe(pool: WorkerPool, target: FunctionTarget, role: str) -> FunctionFacts:
    process = pool.start(target.release, target.name(role))
    try:
        pool.wait_for(process, target.release)
        process.call(import_function, target.source)
        return process.call(try_function, target.origin)
    finally:
        pool.end([process])


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


def _launch(pair: FunctionPair, count: int) -> None:
    with pair:
        pair.prepare()
        while len(pair.launches) < count and pair.has_time(has_answer=False):
            pair.launch()


class _Decision:
    def __init__(
        self,
        pool: WorkerPool,
        targets: FunctionTargets,
        plan: VerdictPlan,
        on_launch: Callable[[Judgement], None],
        clock: Callable[[], float],
    ):
        self._pool, self._targets, self._plan = pool, targets, plan
        self._on_launch, self._clock, self._begin_s = on_launch, clock, clock()
        self._observed: _Observed | None = None
        self._control: Sequence[LaunchRow] = ()
        self._launches: Sequence[LaunchRow] = ()

    def run(self) -> VerdictRecord:
        baseline, candidate = self._targets
        if _code(baseline) == _code(candidate):
            same = "revisions have the same files" if baseline.revision else "environments are one"
            detail = f"both {same}, so nothing was timed"
            return self._record(Failure(Status.OK, detail), Verdict.SAME)
        try:
            self._observed = _observe(self._pool, self._targets)
        except (OtherCodeError, BuildError):  # of all functions
            raise
        except _NewError as error:
            return self._record(Failure(Status.NEW, str(error)))
        except ENDING_ERRORS as error:
            return self._record(ending_of(error))
        results = self._observed.results
        if results.outcome == ResultsOutcome.DIFFERENT:
            detail = f"results differ: {results.detail}; no verdict on speed"
            return self._record(Failure(Status.DISAGREES, detail))
        facts = self._observed.baseline, self._observed.candidate
        return self._timed(CallPlan.of(facts, self._plan.sizes.metric))

    def _timed(self, calls: CallPlan) -> VerdictRecord:
        """Launch the control, then both sides, until the verdict is certain or time is up."""
        baseline, limit_s = self._targets[0], self._plan.time_limit_s
        begin_s = self._clock()
        # half of the time for half of the launches
        pair = self._pair((baseline, baseline), calls, limit_s / 2)
        _launch(pair, MIN_LAUNCHES)
        self._control = pair.launches
        # a budget is for both, and what ended the control ends the verdict
        if pair.ending.status == Status.OK and len(self._control) == MIN_LAUNCHES:
            pair = self._pair(self._targets, calls, limit_s - (self._clock() - begin_s))
            with pair:
                pair.prepare()
                launch_until_certain(pair, self._plan, self._on_launch)
            self._launches = pair.launches
        verdict = Verdict.INCONCLUSIVE if pair.ending.status == Status.OK else None
        return self._record(pair.ending, verdict)

    def _pair(self, targets: FunctionTargets, calls: CallPlan, limit_s: float) -> FunctionPair:
        limit = TimeLimit(
            limit_s, 2 * MIN_LAUNCHES, self._clock, purpose="a verdict with its control"
        )
        return FunctionPair(self._pool, targets, calls, limit)

    def _compiling(self, observed: _Observed) -> Pair[CompilationFigures] | None:
        first = observed.baseline.compilation, observed.candidate.compilation
        if first[0] is None or first[1] is None:
            return None
        launched = [each.compilations for each in self._launches if each.compilations]
        is_timed = METRICS[self._plan.sizes.metric].is_of_steps
        runs_s = [launch.block_s for launch in self._launches] if is_timed else []
        return Pair(
            CompilationFigures.of([first[0], *(e.old for e in launched)], [s.old for s in runs_s]),
            CompilationFigures.of([first[1], *(e.new for e in launched)], [s.new for s in runs_s]),
        )

    def _record(self, ending: Failure, verdict: Verdict | None = None) -> VerdictRecord:
        """Return the verdict as a run file stores it; `verdict` is that without any launch."""
        baseline, candidate = self._targets
        observed, launches, run = self._observed, self._launches, candidate.run
        detail, metric = ending.detail, self._plan.sizes.metric
        judgement = judge_launches(launches, self._plan)
        if judgement is not None:
            verdict = judgement.verdict if ending.status == Status.OK else None
        control = control_row(self._control, self._plan.confidence)
        if verdict is not None and control is not None and not control.covers:
            verdict, detail = Verdict.INCONCLUSIVE, detail or "the baseline differs from itself"
        is_timed = bool(launches) and METRICS[metric].is_of_steps
        return VerdictRecord(
            model=candidate.function,
            path=candidate.path,
            old=baseline.label,
            new=candidate.label,
            sides=(baseline.row(), candidate.row()),
            metric=metric,
            status=ending.status,
            detail=detail,
            verdict=verdict,
            ratio=judgement.ratio if judgement else None,
            e_slower=min(judgement.e_slower, MAX_E_VALUE) if judgement else None,
            e_faster=min(judgement.e_faster, MAX_E_VALUE) if judgement else None,
            changed_work=observed.results.is_changed if observed else None,
            nbatch=run.nbatch if run else None,
            nstep=run.nstep if run else None,
            starts=run.starts if run else None,
            launches=len(launches),
            pairs=2 * sum(len(launch.orders) for launch in launches),
            seconds=self._clock() - self._begin_s,
            results=observed.results.outcome if observed else None,
            results_detail=observed.results.detail if observed else "",
            control=control,
            calls_s=Pair(observed.baseline.call_s, observed.candidate.call_s) if observed else None,
            slowing=statistics.median(each.slowing for each in launches) if is_timed else None,
            packages=package_versions(baseline.release, candidate.release),
            compiling=self._compiling(observed) if observed else None,
            samples=launches,
            control_samples=self._control,
        )


def decide(
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
