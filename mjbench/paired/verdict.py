"""Decide which of two targets is faster: launch them until the verdict is certain.

`judge` decides from the launches so far; `decide` launches until `judge` has enough.
"""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from mjbench.instrument import anytime
from mjbench.instrument.anytime import Evidence
from mjbench.instrument.ratio import Ratio
from mjbench.paired import outcomes
from mjbench.paired.averaging import Averaging, averaging
from mjbench.paired.ending import ENDING_ERRORS, ending_of
from mjbench.paired.judgement import MIN_LAUNCHES, Judgement, conclude, judge
from mjbench.paired.outcomes import Cause, Metric, Verdict
from mjbench.paired.preparation import WorkCheck
from mjbench.paired.protocol import Launch, TargetPair
from mjbench.paired.records import (
    MAX_E_VALUE,
    LaunchRow,
    Pair,
    PlacementEffect,
    VerdictRecord,
    VerdictRow,
)
from mjbench.paired.run_sizes import Sizes
from mjbench.paired.targets import Target
from mjbench.paired.time_limit import TimeLimit
from mjbench.paired.worker_pool import WorkerPool
from mjbench.status import Status

# Unless another is asked for.
CONFIDENCE = outcomes.CONFIDENCE


@dataclass(frozen=True)
class VerdictPlan:
    """How certain a verdict must be, and what it may cost.

    Attributes:
      min_effect: smallest change of time that matters, such as 0.01.
      confidence: that a verdict is right, such as 0.99.
      precision: half-width of the interval at which to stop in any case.
      time_limit_s: seconds from when the models are loaded, after which no launch begins; see
        `time_limit`.
      sizes: of a run.
      as_shipped: whether code stays where each build has it, instead of being moved from launch to
        launch, so that its placement averages out.
      family: number of comparisons that are decided together; a change needs more evidence.
    """

    min_effect: float = outcomes.MIN_EFFECT
    confidence: float = CONFIDENCE
    precision: float = outcomes.PRECISION
    time_limit_s: float = outcomes.TIME_LIMIT_S
    sizes: Sizes = field(default_factory=Sizes)
    as_shipped: bool = False
    family: int = 1


@dataclass(frozen=True, eq=False)
class PairedResult:
    """How a comparison ended.

    Attributes:
      baseline: the one target.
      candidate: the other.
      status: `OK`, `INPUT`, `FAILED` or `INTERRUPTED`.
      detail: one line; empty when ok, unless time ran out before there were enough launches.
      metric: what was compared.
      work_check: whether it was the same work; None where the comparison ended before that.
      workload_file: the baseline's `PortableWorkload`, which lasts as long as the pool; None where
        the comparison ended before that.
      launches: what each launch measured.
      averaging: whether launches moved the libraries; None where the comparison ended before that.
      judgement: of the launches that moved them, or of all if none did; None without any.
      as_shipped: of the launches as shipped, beside them; None without any.
      seconds: from start to verdict, the workers' start included.
    """

    baseline: Target
    candidate: Target
    status: Status
    detail: str = ""
    metric: Metric = Metric.TIME
    work_check: WorkCheck | None = None
    workload_file: Path | None = None
    launches: Sequence[Launch] = ()
    averaging: Averaging | None = None
    judgement: Judgement | None = None
    as_shipped: Judgement | None = None
    seconds: float = 0.0

    def row(self) -> VerdictRow:
        """Return the comparison as people and programs read it."""
        check, judgement = self.work_check, self.judgement
        return VerdictRow(
            model=self.candidate.model.name,
            path=self.candidate.path,
            old=self.baseline.release.version,
            new=self.candidate.release.version,
            sides=(self.baseline.row(), self.candidate.row()),
            metric=self.metric,
            status=self.status,
            detail=self.detail,
            verdict=self._verdict(),
            ratio=ratio_of(judgement) if judgement else None,
            e_slower=min(judgement.e_slower, MAX_E_VALUE) if judgement else None,
            e_faster=min(judgement.e_faster, MAX_E_VALUE) if judgement else None,
            cause=self._cause(),
            placement=self._placement(),
            changed_work=check.changed if check else None,
            work=Pair(check.baseline, check.candidate) if check else None,
            drift=check.drift.one_step if check and check.drift else None,
            run_drift=check.drift.runs if check and check.drift else (),
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
        )

    def _verdict(self) -> Verdict | None:
        """Return the verdict; time may run out before the first launch."""
        if self.judgement is not None:
            return self.judgement.verdict
        return Verdict.INCONCLUSIVE if self.status == Status.OK else None

    def _cause(self) -> Cause | None:
        """Return why the builds differ; None where they do not, or where more than the build does.

        What is called `same` differs by placement if it does so as shipped, and if as shipped it is
        certainly another ratio.
        """
        baseline, candidate = self.baseline, replace(self.candidate, release=self.baseline.release)
        if self.judgement is None or self.averaging is None or baseline != candidate:
            return None
        verdict = self.judgement.verdict
        if verdict == Verdict.SAME:
            differs = self.as_shipped and self.as_shipped.verdict in (
                Verdict.FASTER,
                Verdict.SLOWER,
            )
            effect = self._placement_effect()
            is_certain = effect is not None and not effect.covers(1.0)
            return Cause.PLACEMENT if differs and is_certain else None
        if verdict == Verdict.INCONCLUSIVE:
            return Cause.UNDECIDED
        if self.work_check is not None and self.work_check.changed:
            return Cause.WORK
        return Cause.CODE if self.averaging.is_on else Cause.UNDECIDED

    def _placement(self) -> PlacementEffect | None:
        if self.averaging is None:
            return None
        if not self.averaging.is_on:
            return PlacementEffect(False, self.averaging.problem)
        if self.as_shipped is None:
            return PlacementEffect(True)
        return PlacementEffect(
            True, as_shipped=ratio_of(self.as_shipped), effect=self._placement_effect()
        )

    def _placement_effect(self) -> Ratio | None:
        """Return the ratio as shipped over the averaged one; None where one was not measured."""
        if self.judgement is None or self.as_shipped is None:
            return None
        return _quotient(ratio_of(self.as_shipped), ratio_of(self.judgement))

    def record(self) -> VerdictRecord:
        """Return the comparison as a run file stores it, with every launch's raw times."""
        return record_of(self.row(), [launch.row() for launch in self.launches])


def record_of(row: VerdictRow, samples: Sequence[LaunchRow] = ()) -> VerdictRecord:
    """Return a verdict as a run file stores it.

    Args:
      row: the verdict.
      samples: raw times of every launch; none where instructions were compared.
    """
    return VerdictRecord(**vars(row), samples=samples)


def ratio_of(judgement: Judgement) -> Ratio:
    """Return estimate and interval; both ends are None where launches are too few for one."""
    if not math.isfinite(judgement.high):
        return Ratio(judgement.ratio, None, None)
    return Ratio(judgement.ratio, judgement.low, judgement.high)


def _quotient(numerator: Ratio, denominator: Ratio) -> Ratio:
    """Return a ratio over another; its interval holds the truth if both of theirs do."""
    estimate = numerator.estimate / denominator.estimate
    if None in (numerator.low, numerator.high, denominator.low, denominator.high):
        return Ratio(estimate, None, None)
    assert numerator.low and numerator.high and denominator.low and denominator.high
    return Ratio(estimate, numerator.low / denominator.high, numerator.high / denominator.low)


def decide(
    pool: WorkerPool,
    baseline: Target,
    candidate: Target,
    plan: VerdictPlan,
    on_launch: Callable[[Judgement], None] = lambda judgement: None,
    clock: Callable[[], float] = time.monotonic,
) -> PairedResult:
    """Compare two targets until the verdict is certain, or time is up.

    Where a target crashes, hangs or fails, or Ctrl-C is pressed, the result says so, and holds what
    was measured until then.

    Args:
      pool: starts the processes.
      baseline: the one target.
      candidate: the other.
      plan: how certain, and for how long.
      on_launch: called after each launch, with what all launches say so far.
      clock: returns seconds.
    """
    begin = clock()
    launches: list[Launch] = []
    pair: TargetPair | None = None
    averaged: Averaging | None = None
    status, detail = Status.OK, ""
    try:
        averaged = (
            Averaging(False)
            if plan.as_shipped
            else averaging(pool, baseline.release, candidate.release)
        )
        time_limit = TimeLimit(plan.time_limit_s, averaged.launches_with(MIN_LAUNCHES), clock)
        placements = averaged.placements()
        pair = TargetPair(pool, baseline, candidate, plan.sizes, time_limit, placements)
        _launch_until_enough(pair, plan, time_limit, launches, on_launch)
    except ENDING_ERRORS as error:
        ending = ending_of(error)
        status, detail = ending.status, ending.detail
    finally:
        if pair is not None:
            pair.close()
    log_scale = _log_scale(pair, plan) if pair else 0.0
    return PairedResult(
        baseline,
        candidate,
        status,
        detail,
        plan.sizes.metric,
        work_check=pair.work_check if pair else None,
        workload_file=pair.baseline_workload if pair else None,
        launches=launches,
        averaging=averaged,
        judgement=_judge_launches(launches, plan, log_scale),
        as_shipped=(
            _judge_as_shipped(launches, plan, log_scale) if averaged and averaged.is_on else None
        ),
        seconds=clock() - begin,
    )


def _launch_until_enough(
    pair: TargetPair,
    plan: VerdictPlan,
    time_limit: TimeLimit,
    launches: list[Launch],
    on_launch: Callable[[Judgement], None],
) -> None:
    """Add launches to a list until they are enough, or time is up; see `decide`.

    Raises:
      OutOfTimeError: time is up before there are enough launches for a verdict.
    """
    before_s, log_scale = time_limit.spent_s(), _log_scale(pair, plan)
    while True:
        launches.append(pair.launch())
        judgement = _judge_launches(launches, plan, log_scale)
        assert judgement is not None, "there is a launch"
        on_launch(judgement)
        can_judge = judgement.launches >= MIN_LAUNCHES
        if judgement.enough or not time_limit.allows_another(len(launches), before_s, can_judge):
            return


def _log_scale(pair: TargetPair, plan: VerdictPlan) -> float:
    """Return what turns log ratios of the time of a step into those that are judged.

    Where timesteps differ, they are of the time of a simulated second; not the slowest steps, which
    have to keep up with a rate.
    """
    return pair.work_check.log_scale if plan.sizes.metric == Metric.TIME else 0.0


def _judge_launches(
    launches: Sequence[Launch], plan: VerdictPlan, log_scale: float
) -> Judgement | None:
    """Judge the launches in which code was moved, or all if it never was; None without any."""
    moved = [launch for launch in launches if launch.placements.is_moved]
    used = moved or launches
    if not used:
        return None
    return judge(
        [launch.log_ratio + log_scale for launch in used],
        plan.min_effect,
        plan.confidence,
        plan.precision,
        [launch.placements.residue for launch in moved] or None,
        plan.family,
    )


def _judge_as_shipped(
    launches: Sequence[Launch], plan: VerdictPlan, log_scale: float
) -> Judgement | None:
    """Judge the launches as shipped beside those in which code was moved; None without any."""
    moved = [launch for launch in launches if launch.placements.is_moved]
    shipped = [
        launch.log_ratio + log_scale for launch in launches if not launch.placements.is_moved
    ]
    if not shipped:
        return None
    interval = anytime.interval_beside(
        shipped,
        plan.confidence,
        [launch.log_ratio + log_scale for launch in moved],
        [launch.placements.residue for launch in moved],
    )
    return conclude(Evidence(interval, 1.0, 1.0), plan.min_effect, plan.confidence, plan.precision)
