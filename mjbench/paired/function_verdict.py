"""Decide whether a function is slower in one revision of the user's code, or in one environment.

Before anything is timed, the code must be that of the two sides, and results must be the same. A
control is measured beside the verdict: the baseline against itself, in as many launches as a
verdict needs at least. Where the baseline differs from itself, nothing is decided.
"""

import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from mjbench.errors import Failure, InputError, MachineError, UnavailableError
from mjbench.measuring import anytime
from mjbench.measuring.ratio import Ratio
from mjbench.paired.call_results import ResultsCheck, compare
from mjbench.paired.function_pair import (
    CallPlan,
    FunctionTarget,
    FunctionTargets,
    RevisionPair,
    observe,
)
from mjbench.paired.judgement import MIN_LAUNCHES, Judgement
from mjbench.paired.metrics import Metric
from mjbench.paired.outcomes import ResultsOutcome, Verdict
from mjbench.paired.pair_rule import LaunchRule, Sufficiency
from mjbench.paired.records import (
    MAX_E_VALUE,
    CompilationFigures,
    ControlRow,
    LaunchRow,
    Pair,
    VerdictRecord,
)
from mjbench.paired.time_limit import ENDING_ERRORS, TimeLimit, ending_of
from mjbench.paired.timed_function import FunctionFacts
from mjbench.paired.verdict import VerdictPlan, judge_launches, package_versions
from mjbench.paired.worker_pool import WorkerPool
from mjbench.releases.pip import BuildError
from mjbench.status import ExitCode, Status


class OtherCodeError(MachineError):
    """What would have been measured is not the code of a revision (exit code 5)."""

    exit_code = ExitCode.OTHER_CODE


class _FixedRule(LaunchRule):
    purpose = "a verdict with its control"

    def __init__(self, pair: RevisionPair, count: int, clock: Callable[[], float] = time.monotonic):
        super().__init__(pair, clock)
        self._count = count

    def look(self, launches: Sequence[LaunchRow]) -> Sufficiency:
        is_enough = len(launches) >= self._count
        return Sufficiency(is_enough, is_enough)


class _FunctionRule(LaunchRule):
    purpose = "a verdict"

    def __init__(
        self,
        pair: RevisionPair,
        plan: VerdictPlan,
        on_launch: Callable[[Judgement], None],
        clock: Callable[[], float],
    ):
        super().__init__(pair, clock)
        self._plan, self._on_launch = plan, on_launch

    def look(self, launches: Sequence[LaunchRow]) -> Sufficiency:
        judgement = judge_launches(launches, self._plan)
        assert judgement is not None, "there is a launch"
        self._on_launch(judgement)
        return Sufficiency(judgement.enough, judgement.launches >= MIN_LAUNCHES)


def control_row(launches: Sequence[LaunchRow], confidence: float) -> ControlRow | None:
    """Return what launches of the baseline against itself show; None without any."""
    if not launches:
        return None
    log_ratios = [launch.log_ratio for launch in launches]
    interval = anytime.anytime_interval(log_ratios, confidence)
    ratio = Ratio.of_log(interval.mean, interval.half_width)
    return ControlRow(ratio, len(launches), interval.low <= 0 <= interval.high)


def check_versions(baseline: FunctionFacts, candidate: FunctionFacts) -> None:
    """Refuse sides that ran on another Python, MuJoCo, NumPy or JAX (OtherCodeError)."""
    for name in baseline.versions.keys() & candidate.versions.keys():
        old, new = baseline.versions[name], candidate.versions[name]
        if old != new:
            raise OtherCodeError(f"the baseline ran on {name} {old}, the candidate on {new}")


def _code(target: FunctionTarget) -> tuple[str, str]:
    """Return what is the same on two sides where both run the same code."""
    return target.tree, target.release.key


def check_origin(target: FunctionTarget, role: str, facts: FunctionFacts) -> None:
    """Refuse a side that imported other code than its revision's (OtherCodeError)."""
    if facts.misplaced:
        raise OtherCodeError(
            f"{target.name(role)} imported {facts.misplaced}, which is not the"
            f" {'revision' if target.revision else 'environment'}'s: uninstall an editable install"
            " of the package"
        )


def compare_results(
    baseline: FunctionFacts, again: FunctionFacts, candidate: FunctionFacts
) -> ResultsCheck:
    """Return how results compare; `again` is of the baseline, and shows whether its are random."""
    for facts in (baseline, candidate):
        if facts.problem:
            return ResultsCheck(ResultsOutcome.NONE, facts.problem)
    own = compare(baseline.results, again.results)
    if own.outcome == ResultsOutcome.DIFFERENT:
        return ResultsCheck(ResultsOutcome.RANDOM, f"of one revision, {own.detail}")
    return compare(baseline.results, candidate.results)


@dataclass(frozen=True)
class _Observed:
    """What is known before anything is timed."""

    baseline: FunctionFacts
    candidate: FunctionFacts
    results: ResultsCheck


class _NewError(Exception):
    """The candidate can do it, and the baseline cannot."""


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
        # half of the time for half of the launches
        pair = self._pair((baseline, baseline), calls, limit_s / 2)
        ended = _FixedRule(pair, MIN_LAUNCHES, self._clock).run()
        self._control = ended.launches
        if ended.is_enough:  # a budget is for both
            pair = self._pair(self._targets, calls, limit_s - ended.seconds)
            ended = _FunctionRule(pair, self._plan, self._on_launch, self._clock).run()
            self._launches = ended.launches
        verdict = Verdict.INCONCLUSIVE if ended.status == Status.OK else None
        return self._record(Failure(ended.status, ended.detail), verdict)

    def _pair(self, targets: FunctionTargets, calls: CallPlan, limit_s: float) -> RevisionPair:
        limit = TimeLimit(limit_s, 2 * MIN_LAUNCHES, self._clock, _FixedRule.purpose)
        return RevisionPair(self._pool, targets, calls, limit)

    def _compiling(self, observed: _Observed) -> Pair[CompilationFigures] | None:
        first = observed.baseline.compilation, observed.candidate.compilation
        if first[0] is None or first[1] is None:
            return None
        launched = [each.compilations for each in self._launches if each.compilations]
        is_timed = self._plan.sizes.metric == Metric.TIME
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
        is_timed = bool(launches) and metric == Metric.TIME
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
    """Compare a function of two revisions until the verdict is certain, or time is up.

    Raises:
      OtherCodeError: the code that would be measured is not the revisions' own.
      BuildError: what a revision needs cannot be installed.
    """
    return _Decision(pool, targets, plan, on_launch, clock).run()


def launch_log_ratios(pool: WorkerPool, targets: FunctionTargets, count: int) -> list[float]:
    """Return the log ratios of some launches, whatever they say.

    Raises:
      InputError: a side cannot do it, or their results differ.
    """
    try:
        observed = _observe(pool, targets)
    except _NewError as error:
        raise InputError(str(error)) from error
    if observed.results.outcome == ResultsOutcome.DIFFERENT:
        raise InputError(f"results differ: {observed.results.detail}")
    calls = CallPlan.of((observed.baseline, observed.candidate))
    launched = _FixedRule(RevisionPair(pool, targets, calls, TimeLimit()), count).run()
    if launched.status == Status.INTERRUPTED:
        raise KeyboardInterrupt
    if launched.status != Status.OK:
        raise MachineError(launched.detail)
    return [launch.log_ratio for launch in launched.launches]
