"""Decide which of two targets is faster: launch them until the verdict is certain.

`judge` decides from the launches so far; `decide` launches until `judge` has enough.
"""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from mjbench.errors import InputError, MachineError, failure_of
from mjbench.instrument import stats
from mjbench.paired.outcomes import Verdict
from mjbench.paired.preparation import Sizes, WorkCheck
from mjbench.paired.protocol import Launch, TargetPair
from mjbench.paired.records import (
    DivergedPair,
    LaunchRow,
    Ratio,
    VerdictRecord,
    VerdictRow,
    WarningsPair,
    WorkPair,
)
from mjbench.paired.targets import Target
from mjbench.paired.time_limit import OutOfTimeError, TimeLimit
from mjbench.paired.worker_pool import WorkerPool
from mjbench.status import Status

# A verdict of faster or slower is final when its interval's half-width is at most this share of the
# change.
SHARE = 0.8
# Fewer launches give no verdict, however clear: a few numbers do not estimate a deviation.
MIN_LAUNCHES = 6


@dataclass(frozen=True)
class Judgement:
    """What launches show about the ratio of candidate time to baseline time.

    Attributes:
      verdict: the outcome.
      ratio: estimate of candidate time over baseline time.
      low: lower end of its interval.
      high: upper end of its interval.
      launches: number of launches.
      enough: whether more launches are unnecessary for the verdict and precision asked for.
    """

    verdict: Verdict
    ratio: float
    low: float
    high: float
    launches: int
    enough: bool


def judge(
    log_ratios: Sequence[float], min_effect: float, confidence: float, precision: float
) -> Judgement:
    """Judge launches, each the natural logarithm of candidate time over baseline time.

    The verdict is `same` if the whole interval is within the smallest effect that matters. It is
    `slower` or `faster` if the interval excludes "no change" and the estimate is nearer to that
    effect than to no change.

    Launches are enough if the verdict is `same`, or if the interval's half-width is at most a SHARE
    of the change (to stop as soon as the interval excludes "no change" would overstate the change).
    They are also enough if the half-width is at most `precision`, or half of the smallest effect if
    that is less.

    Args:
      log_ratios: one per launch.
      min_effect: smallest effect that matters, such as 0.01.
      confidence: such as 0.99; of the whole procedure, however often it is called.
      precision: such as 0.005.
    """
    interval = stats.anytime_interval(log_ratios, confidence)
    log_effect = float(np.log1p(min_effect))
    verdict = _verdict(interval, log_effect)
    # half of the effect: an interval as wide as the effect on both sides could never be `same`
    precise = min(float(np.log1p(precision)), log_effect / 2)
    narrow = max(precise, abs(interval.mean) * SHARE)
    has_launches = interval.count >= MIN_LAUNCHES
    return Judgement(
        verdict if has_launches else Verdict.INCONCLUSIVE,
        float(np.exp(interval.mean)),
        float(np.exp(interval.low)),
        float(np.exp(interval.high)),
        interval.count,
        has_launches and (verdict == Verdict.SAME or interval.half_width <= narrow),
    )


def _verdict(interval: stats.Interval, log_effect: float) -> Verdict:
    """Return the verdict on an interval of log ratios (see `judge`)."""
    if -log_effect < interval.low and interval.high < log_effect:
        return Verdict.SAME
    if interval.low > 0 and interval.mean > log_effect / 2:
        return Verdict.SLOWER
    if interval.high < 0 and interval.mean < -log_effect / 2:
        return Verdict.FASTER
    return Verdict.INCONCLUSIVE


@dataclass(frozen=True)
class VerdictPlan:
    """How certain a verdict must be, and what it may cost.

    Attributes:
      min_effect: smallest change of time that matters, such as 0.01.
      confidence: that a verdict is right, such as 0.99.
      precision: half-width of the interval at which to stop in any case.
      time_limit_s: seconds from when the models are loaded, after which no launch begins; see
        `time_limit`.
      sizes: of a block's work.
    """

    min_effect: float = 0.01
    confidence: float = 0.99
    precision: float = 0.005
    time_limit_s: float = 60.0
    sizes: Sizes = field(default_factory=Sizes)


@dataclass(frozen=True, eq=False)
class PairedResult:
    """How a comparison ended.

    Attributes:
      baseline: the one target.
      candidate: the other.
      status: `OK`, `INPUT`, `FAILED` or `INTERRUPTED`.
      detail: one line; empty when ok, unless time ran out before there were enough launches.
      work_check: whether it was the same work; None where the comparison ended before that.
      workload_file: the baseline's `PortableWorkload`, which lasts as long as the pool; None where
        the comparison ended before that.
      launches: what each launch measured.
      judgement: None without launches.
      seconds: from start to verdict, the workers' start included.
    """

    baseline: Target
    candidate: Target
    status: Status
    detail: str = ""
    work_check: WorkCheck | None = None
    workload_file: Path | None = None
    launches: Sequence[Launch] = ()
    judgement: Judgement | None = None
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
            status=self.status,
            detail=self.detail,
            verdict=self._verdict(),
            ratio=ratio_of(judgement) if judgement else None,
            changed_work=check.changed if check else None,
            work=WorkPair(check.baseline, check.candidate) if check else None,
            drift=check.drift.one_step if check and check.drift else None,
            run_drift=check.drift.runs if check and check.drift else (),
            diverged=DivergedPair(*check.diverged) if check else None,
            warnings=WarningsPair(*check.warnings) if check else None,
            nbatch=check.nbatch if check else None,
            nstep=check.nstep if check else None,
            starts=check.starts if check else None,
            launches=len(self.launches),
            pairs=2 * sum(len(launch.orders) for launch in self.launches),
            seconds=self.seconds,
        )

    def _verdict(self) -> Verdict | None:
        """Return the verdict; time may run out before the first launch."""
        if self.judgement is not None:
            return self.judgement.verdict
        return Verdict.INCONCLUSIVE if self.status == Status.OK else None

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
    time_limit = TimeLimit(plan.time_limit_s, MIN_LAUNCHES, clock)
    launches: list[Launch] = []
    pair: TargetPair | None = None
    status, detail = Status.OK, ""
    try:
        pair = TargetPair(pool, baseline, candidate, plan.sizes, time_limit)
        _launch_until_enough(pair, plan, time_limit, launches, on_launch)
    except OutOfTimeError as error:
        detail = str(error)
    except (InputError, MachineError) as error:
        failure = failure_of(error)
        status, detail = failure.status, failure.detail
    except KeyboardInterrupt:
        status, detail = Status.INTERRUPTED, "interrupted"
    finally:
        if pair is not None:
            pair.close()
    return PairedResult(
        baseline,
        candidate,
        status,
        detail,
        work_check=pair.work_check if pair else None,
        workload_file=pair.baseline_workload if pair else None,
        launches=launches,
        judgement=_judge_launches(launches, plan) if launches else None,
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
    before_s = time_limit.spent_s()
    while True:
        launches.append(pair.launch())
        judgement = _judge_launches(launches, plan)
        on_launch(judgement)
        if judgement.enough or not time_limit.allows_another(len(launches), before_s):
            return


def _judge_launches(launches: Sequence[Launch], plan: VerdictPlan) -> Judgement:
    log_ratios = [launch.log_ratio for launch in launches]
    return judge(log_ratios, plan.min_effect, plan.confidence, plan.precision)
