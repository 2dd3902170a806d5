"""Decide which of two targets is faster: launch them until the verdict is certain.

`judge` is the rule: what launches show, and whether they are enough. `decide` launches until they
are, and makes the record.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from mjbench.measuring import launch_stats
from mjbench.measuring.launch_stats import Evidence, Interval
from mjbench.measuring.ratio import Ratio
from mjbench.paired import outcomes
from mjbench.paired.call_results import ResultsCheck
from mjbench.paired.metrics import METRICS, Metric
from mjbench.paired.moved_check import Averaging, averaging
from mjbench.paired.outcomes import Cause, Verdict
from mjbench.paired.pair_launches import LaunchedPair, WorkCheck
from mjbench.paired.records import (
    MAX_E_VALUE,
    LaunchRow,
    PackageVersions,
    Pair,
    PlacementEffect,
    VerdictRecord,
    VerdictRow,
)
from mjbench.paired.run_sizes import Sizes
from mjbench.paired.target_pair import TargetPair
from mjbench.paired.targets import Target
from mjbench.paired.time_limit import TimeLimit
from mjbench.paired.worker_pool import WorkerPool
from mjbench.releases import installs
from mjbench.releases.release_names import ReleaseSpec
from mjbench.status import Status

# A verdict of faster or slower is final when its interval's half-width is at most this share of the
# change.
SHARE = 0.8
# Fewer launches give no verdict, however clear: of launches in two modes, the first six are of one
# mode in 3 % of comparisons, the first eight in 0.8 %. With placements, it is two of each residue.
MIN_LAUNCHES = 8


@dataclass(frozen=True)
class VerdictPlan:
    """How certain a verdict must be, and what it may cost.

    Attributes:
      precision: half-width of the interval at which to stop in any case.
      time_limit_s: seconds from when the models are loaded, after which no launch begins; see
        `time_limit`.
      as_shipped: whether code stays where each build has it, instead of being moved from launch to
        launch, so that its placement averages out.
      family: number of comparisons that are decided together; a change needs more evidence.
    """

    min_effect: float = outcomes.MIN_EFFECT
    confidence: float = outcomes.CONFIDENCE
    precision: float = outcomes.PRECISION
    time_limit_s: float = outcomes.TIME_LIMIT_S
    sizes: Sizes = field(default_factory=Sizes)
    as_shipped: bool = False
    family: int = 1


@dataclass(frozen=True)
class Judgement:
    """What launches show about the ratio of candidate time to baseline time.

    Attributes:
      enough: whether more launches are unnecessary for the verdict and precision asked for.
      e_slower: e-value against "not slower" (see `launch_stats.Fit.e_values`); 1 is no evidence.
    """

    verdict: Verdict
    ratio: Ratio
    launches: int
    enough: bool
    e_slower: float = 1.0
    e_faster: float = 1.0


def judge(
    log_ratios: Sequence[float],
    min_effect: float,
    confidence: float,
    precision: float,
    residues: Sequence[int] | None = None,
    family: int = 1,
) -> Judgement:
    """Judge launches, each the natural logarithm of candidate time over baseline time.

    The verdict is `same` if the whole interval is within the smallest effect that matters. It is
    `slower` or `faster` if the interval excludes "no change" and the estimate is nearer to that
    effect than to no change.

    Launches are enough if the verdict is `same`, or if the interval's half-width is at most a SHARE
    of the change (to stop as soon as the interval excludes "no change" would overstate the change).
    They are also enough if the half-width is at most `precision`, or half of the smallest effect if
    that is less. In a family of comparisons, `slower` and `faster` need more: an e-value that
    suffices for any number of changes in the family (see `launch_stats.e_benjamini_hochberg`).

    Args:
      confidence: of the whole procedure, however often it is called.
      residues: of the launches' placements; None if libraries stay where they are.
    """
    evidence = launch_stats.evidence(log_ratios, confidence, residues)
    return conclude(evidence, min_effect, confidence, precision, family)


def exact_verdict(ratio: float, min_effect: float) -> Verdict:
    if ratio >= 1 + min_effect:
        return Verdict.SLOWER
    return Verdict.FASTER if ratio <= 1 / (1 + min_effect) else Verdict.SAME


def conclude(
    evidence: Evidence, min_effect: float, confidence: float, precision: float, family: int = 1
) -> Judgement:
    """Judge what launches show; see `judge` for the rule and the other arguments."""
    interval = evidence.interval
    log_effect = float(np.log1p(min_effect))
    has_launches = interval.count >= MIN_LAUNCHES
    verdict = _verdict(interval, log_effect) if has_launches else Verdict.INCONCLUSIVE
    # half of the effect: an interval as wide as the effect on both sides could never be `same`
    precise = min(float(np.log1p(precision)), log_effect / 2)
    is_narrow = interval.half_width <= max(precise, abs(interval.mean) * SHARE)
    is_change = verdict in (Verdict.SLOWER, Verdict.FASTER)
    e_value = evidence.e_positive if interval.mean > 0 else evidence.e_negative
    is_sure = not is_change or e_value * (1 - confidence) >= family
    return Judgement(
        verdict,
        Ratio.of_log(interval.mean, interval.half_width),
        interval.count,
        has_launches and (verdict == Verdict.SAME or (is_narrow and is_sure)),
        evidence.e_positive,
        evidence.e_negative,
    )


def _verdict(interval: Interval, log_effect: float) -> Verdict:
    if -log_effect < interval.low and interval.high < log_effect:
        return Verdict.SAME
    if interval.low > 0 and interval.mean > log_effect / 2:
        return Verdict.SLOWER
    if interval.high < 0 and interval.mean < -log_effect / 2:
        return Verdict.FASTER
    return Verdict.INCONCLUSIVE


@dataclass(frozen=True, eq=False, kw_only=True)
class PairedResult:
    """What launches of two targets gave, and how they ended.

    Attributes:
      status: how they ended; `OK` also where time ran out.
      detail: one line; empty when ok, unless time ran out before there were enough launches.
      seconds: from start to end, the workers' start included.
      judgement: of the launches that moved them, or of all if none did; None without any.
    """

    baseline: Target
    candidate: Target
    status: Status
    metric: Metric = Metric.TIME
    detail: str = ""
    launches: Sequence[LaunchRow] = ()
    seconds: float = 0.0
    work_check: WorkCheck | None = None
    results: ResultsCheck | None = None
    workload_file: Path | None = None
    averaging: Averaging | None = None
    judgement: Judgement | None = None
    as_shipped: Judgement | None = None

    def row(self) -> VerdictRow:
        return self.record().row()

    def record(self) -> VerdictRecord:
        """Return the comparison as a run file stores it, with every launch's raw times."""
        check, judgement, results = self.work_check, self.judgement, self.results
        drift = check.drift if check else None
        return VerdictRecord(
            model=self.candidate.model.name,
            path=self.candidate.path,
            old=self.baseline.release.label,
            new=self.candidate.release.label,
            sides=(self.baseline.row(), self.candidate.row()),
            metric=self.metric,
            status=self.status,
            detail=self.detail,
            verdict=self._verdict(),
            ratio=judgement.ratio if judgement else None,
            e_slower=min(judgement.e_slower, MAX_E_VALUE) if judgement else None,
            e_faster=min(judgement.e_faster, MAX_E_VALUE) if judgement else None,
            cause=self._cause(),
            placement=self._placement(),
            changed_work=self._changed_work(),
            work=Pair(check.baseline, check.candidate) if check else None,
            drift=drift.one_step if drift else None,
            run_drift=drift.runs if drift else (),
            diverged=Pair(*check.diverged) if check else None,
            warnings=Pair(*check.warnings) if check else None,
            nbatch=check.nbatch if check else None,
            nstep=check.nstep if check else None,
            starts=check.starts if check else None,
            candidate_starts=check.candidate_starts if check else None,
            timesteps_s=Pair(*check.timesteps_s) if check and check.log_scale else None,
            launches=len(self.launches),
            pairs=2 * sum(len(launch.orders) for launch in self.launches),
            seconds=self.seconds,
            results=results.outcome if results else None,
            results_detail=results.detail if results else "",
            packages=package_versions(self.baseline.release, self.candidate.release),
            samples=self.launches,
        )

    def _verdict(self) -> Verdict | None:
        if self.judgement is not None:
            return self.judgement.verdict
        return Verdict.INCONCLUSIVE if self.status == Status.OK else None

    def _cause(self) -> Cause | None:
        """Return why the builds differ; None where they do not, or where more than that may.

        What is called `same` differs by placement if it does so as shipped, and if as shipped it is
        certainly another ratio.
        """
        baseline, candidate = self.baseline, replace(self.candidate, release=self.baseline.release)
        releases = self.baseline.release, self.candidate.release
        if (
            not METRICS[self.metric].follows_placement
            or self.judgement is None
            or self.averaging is None
            or baseline != candidate
            or any(release.has_packages for release in releases)
        ):
            return None
        verdict = self.judgement.verdict
        if verdict == Verdict.SAME:
            shipped, effect = self.as_shipped, self._placement_effect()
            differs = shipped and shipped.verdict in (Verdict.FASTER, Verdict.SLOWER)
            is_certain = effect is not None and not effect.covers(1.0)
            return Cause.PLACEMENT if differs and is_certain else None
        if verdict == Verdict.INCONCLUSIVE:
            return Cause.UNDECIDED
        if self._changed_work():
            return Cause.WORK
        return Cause.CODE if self.averaging.is_on else Cause.UNDECIDED

    def _changed_work(self) -> bool | None:
        if self.results is not None:
            return self.results.is_changed
        return self.work_check.changed if self.work_check else None

    def _placement(self) -> PlacementEffect | None:
        if self.averaging is None or not METRICS[self.metric].follows_placement:
            return None
        if not self.averaging.is_on:
            return PlacementEffect(False, self.averaging.problem)
        if self.as_shipped is None:
            return PlacementEffect(True)
        return PlacementEffect(
            True, as_shipped=self.as_shipped.ratio, effect=self._placement_effect()
        )

    def _placement_effect(self) -> Ratio | None:
        """Return the ratio as shipped over the averaged one; None where one was not measured."""
        if self.judgement is None or self.as_shipped is None:
            return None
        return _quotient(self.as_shipped.ratio, self.judgement.ratio)


def package_versions(baseline: ReleaseSpec, candidate: ReleaseSpec) -> list[PackageVersions]:
    """Return the versions of packages in two environments; none where the user named none."""
    if not (baseline.has_packages or candidate.has_packages):
        return []
    old, new = map(installs.package_versions, (baseline, candidate))
    return [
        PackageVersions(name, old.get(name, ""), new.get(name, ""))
        for name in sorted({**old, **new})
    ]


def _quotient(numerator: Ratio, denominator: Ratio) -> Ratio:
    """Return a ratio over another; its interval holds the truth if both of theirs do."""
    low, high = (
        None if end is None or other is None else end / other
        for end, other in ((numerator.low, denominator.high), (numerator.high, denominator.low))
    )
    return Ratio(numerator.estimate / denominator.estimate, low, high)


def decide(
    pool: WorkerPool,
    baseline: Target,
    candidate: Target,
    plan: VerdictPlan,
    on_launch: Callable[[Judgement], None] = lambda judgement: None,
    clock: Callable[[], float] = time.monotonic,
) -> PairedResult:
    """Compare two targets until the verdict is certain, or time is up.

    Where a side crashes, hangs or fails, or Ctrl-C is pressed, the result says so, and holds what
    was measured until then.
    """
    begin_s = clock()
    limit = TimeLimit(plan.time_limit_s, clock=clock, purpose="a verdict")
    averaged: Averaging | None = None
    # time that is up, a failure or Ctrl-C ends the block, not the function: see `pair.ending`
    with TargetPair(pool, baseline, candidate, plan.sizes, limit) as pair:
        averaged = _averaging(pool, baseline, candidate, plan)
        limit.min_launches = averaged.launches_with(MIN_LAUNCHES)
        pair.prepare(averaged.placements())
        launch_until_certain(pair, plan, on_launch)
    log_scale, work = _log_scale(pair, plan), pair.work
    has_moved = averaged is not None and averaged.is_on
    return PairedResult(
        baseline=baseline,
        candidate=candidate,
        status=pair.ending.status,
        metric=plan.sizes.metric,
        detail=pair.ending.detail,
        launches=pair.launches,
        seconds=clock() - begin_s,
        work_check=work.work_check if work else None,
        results=work.results if work else None,
        workload_file=work.baseline_workload if work else None,
        averaging=averaged,
        judgement=judge_launches(pair.launches, plan, log_scale),
        as_shipped=_judge_as_shipped(pair.launches, plan, log_scale) if has_moved else None,
    )


def launch_until_certain(
    pair: LaunchedPair, plan: VerdictPlan, on_launch: Callable[[Judgement], None]
) -> None:
    """Launch a prepared pair until the verdict is certain, or time is up.

    Raises:
      OutOfTimeError: time is up, and there are too few launches for a verdict.
    """
    is_enough = has_answer = False
    while not is_enough and pair.has_time(has_answer):
        pair.launch()
        judgement = judge_launches(pair.launches, plan, _log_scale(pair, plan))
        assert judgement is not None, "there is a launch"
        on_launch(judgement)
        is_enough, has_answer = judgement.enough, judgement.launches >= MIN_LAUNCHES


def _averaging(
    pool: WorkerPool, baseline: Target, candidate: Target, plan: VerdictPlan
) -> Averaging:
    if plan.as_shipped or not METRICS[plan.sizes.metric].follows_placement:
        return Averaging(False)
    return averaging(pool, baseline.release, candidate.release)


def _log_scale(pair: LaunchedPair, plan: VerdictPlan) -> float:
    """Return what turns log ratios of the time of a step into those that are judged.

    Where timesteps differ, they are of the time of a simulated second.
    """
    work_check = pair.work.work_check if pair.work else None
    if work_check is None or not METRICS[plan.sizes.metric].is_of_steps:
        return 0.0
    return work_check.log_scale


def judge_launches(
    launches: Sequence[LaunchRow], plan: VerdictPlan, log_scale: float = 0.0
) -> Judgement | None:
    """Judge launches, with `log_scale` added to their log ratios; None without any."""
    used = [launch for launch in launches if launch.placements.is_moved] or launches
    if not used:
        return None
    return judge(
        [launch.log_ratio + log_scale for launch in used],
        plan.min_effect,
        plan.confidence,
        plan.precision,
        [launch.placements.residue for launch in used if launch.placements.is_moved] or None,
        plan.family,
    )


def _judge_as_shipped(
    launches: Sequence[LaunchRow], plan: VerdictPlan, log_scale: float
) -> Judgement | None:
    moved = [launch for launch in launches if launch.placements.is_moved]
    shipped = [launch for launch in launches if not launch.placements.is_moved]
    if not shipped:
        return None
    interval = launch_stats.interval_beside(
        [launch.log_ratio + log_scale for launch in shipped],
        plan.confidence,
        [launch.log_ratio + log_scale for launch in moved],
        [launch.placements.residue for launch in moved],
    )
    return conclude(Evidence(interval, 1.0, 1.0), plan.min_effect, plan.confidence, plan.precision)
