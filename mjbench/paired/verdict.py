"""Decide which of two targets is faster: launch them until the verdict is certain.

`judge` says what launches show, and whether they are enough. `decide_pair` launches until they are,
and returns the record.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from mjbench.errors import Failure
from mjbench.interval import Interval
from mjbench.measuring import launch_stats
from mjbench.measuring.budget import Budget
from mjbench.measuring.launch_stats import Evidence
from mjbench.paired import outcomes
from mjbench.paired.launches import launch
from mjbench.paired.metrics import METRICS
from mjbench.paired.moved_check import PlacementControl
from mjbench.paired.outcomes import Cause, Verdict
from mjbench.paired.pair_launches import CountRule, PairTargets
from mjbench.paired.records import (
    Judgement,
    LaunchRow,
    PackageVersions,
    PlacementEffect,
    VerdictRecord,
)
from mjbench.paired.run_sizes import Sizes
from mjbench.paired.target_pair import pair_of
from mjbench.paired.targets import Target
from mjbench.paired.time_limit import TimeLimit
from mjbench.paired.worker_pool import WorkerPool
from mjbench.releases import installs
from mjbench.releases.release_names import ReleaseSpec

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
      counts_loading: whether these count from the start.
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
    counts_loading: bool = False

    @property
    def budget(self) -> Budget:
        """The time of a command: of each verdict, or, where that counts loading, of all."""
        total_s = self.time_limit_s if self.counts_loading else None
        return Budget(self.time_limit_s, total_s, "verdict")


def judge(
    log_ratios: Sequence[float], plan: VerdictPlan, residues: Sequence[int] | None = None
) -> Judgement:
    """Judge launches, each the natural logarithm of candidate time over baseline time.

    The verdict is `same` if the whole interval is within the smallest effect that matters. It is
    `slower` or `faster` if the interval excludes "no change" and the estimate is nearer to that
    effect than to no change.

    Launches are enough if the verdict is `same`, or if the interval's half-width is at most a SHARE
    of the change (to stop as soon as the interval excludes "no change" would overstate the change).
    They are also enough if the half-width is at most the precision, or half of the smallest effect
    if that is less. In a family of comparisons, `slower` and `faster` need more: an e-value that
    suffices for any number of changes in the family (see `launch_stats.e_benjamini_hochberg`).

    The confidence is that of the whole procedure, however often this is called.

    Args:
      residues: of the launches' placements; None if libraries stay where they are.
    """
    return conclude(launch_stats.evidence(log_ratios, plan.confidence, residues), plan)


def judge_exactly(ratio: Interval, min_effect: float) -> Judgement:
    """Judge a ratio without noise."""
    verdict = Verdict.SAME
    if ratio.estimate >= 1 + min_effect:
        verdict = Verdict.SLOWER
    elif ratio.estimate <= 1 / (1 + min_effect):
        verdict = Verdict.FASTER
    return Judgement(verdict, ratio, 0, True, None, None)


def conclude(evidence: Evidence, plan: VerdictPlan) -> Judgement:
    """Judge what launches show; see `judge` for the rule."""
    interval = evidence.interval
    log_effect = float(np.log1p(plan.min_effect))
    has_launches = evidence.launches >= MIN_LAUNCHES
    verdict = _verdict(interval, log_effect) if has_launches else Verdict.INCONCLUSIVE
    # half of the effect: an interval as wide as the effect on both sides could never be `same`
    precise = min(float(np.log1p(plan.precision)), log_effect / 2)
    is_narrow = interval.half_width <= max(precise, abs(interval.estimate) * SHARE)
    is_change = verdict in (Verdict.SLOWER, Verdict.FASTER)
    e_value = evidence.e_positive if interval.estimate > 0 else evidence.e_negative
    is_sure = not is_change or e_value * (1 - plan.confidence) >= plan.family
    return Judgement(
        verdict,
        interval.exponential,
        evidence.launches,
        has_launches and (verdict == Verdict.SAME or (is_narrow and is_sure)),
        evidence.e_positive,
        evidence.e_negative,
    )


def _verdict(interval: Interval, log_effect: float) -> Verdict:
    if interval.is_above(-log_effect) and interval.is_below(log_effect):
        return Verdict.SAME
    if interval.is_above(0) and interval.estimate > log_effect / 2:
        return Verdict.SLOWER
    if interval.is_below(0) and interval.estimate < -log_effect / 2:
        return Verdict.FASTER
    return Verdict.INCONCLUSIVE


def package_versions(baseline: ReleaseSpec, candidate: ReleaseSpec) -> list[PackageVersions]:
    """Return the versions of packages in two environments; none where the user named none."""
    if not (baseline.has_packages or candidate.has_packages):
        return []
    old, new = map(installs.package_versions, (baseline, candidate))
    return [
        PackageVersions(name, old.get(name, ""), new.get(name, ""))
        for name in sorted({**old, **new})
    ]


class VerdictRule(CountRule):
    """Launch both sides until the verdict is certain, or time is up.

    Attributes:
      judgement: of the launches until now; None without any.
    """

    def __init__(self, time_limit: TimeLimit, plan: VerdictPlan, pair: PairTargets):
        super().__init__(time_limit)
        self._plan, self._pair = plan, pair
        self.judgement: Judgement | None = None

    @property
    def has_answer(self) -> bool:
        return self.judgement is not None and self.judgement.launches >= MIN_LAUNCHES

    @property
    def has_enough(self) -> bool:
        return self.judgement is not None and self.judgement.enough

    def add(self, launch: LaunchRow) -> None:
        super().add(launch)
        self.judgement = judge_launches(self.launches, self._plan, self._pair.log_scale)


def launch_until_certain(
    pair: PairTargets,
    plan: VerdictPlan,
    time_limit: TimeLimit,
    on_launch: Callable[[Judgement], None],
) -> tuple[VerdictRule, Failure]:
    """Launch a pair until the verdict is certain; return what is known then, and how it ended."""
    rule = VerdictRule(time_limit, plan, pair)

    def show() -> None:
        assert rule.judgement is not None, "there is a launch"
        on_launch(rule.judgement)

    return rule, launch(pair, rule, show)


def decide_pair(
    pool: WorkerPool,
    baseline: Target,
    candidate: Target,
    plan: VerdictPlan,
    on_launch: Callable[[Judgement], None] = lambda judgement: None,
    clock: Callable[[], float] = time.monotonic,
    use_workload: Callable[[Path], None] = lambda file: None,
) -> VerdictRecord:
    """Compare two targets until the verdict is certain, or time is up.

    Where a side crashes, hangs or fails, or Ctrl-C is pressed, the record says so, and holds what
    was measured until then.

    Args:
      use_workload: called with the file of the baseline's workload, if there is one.
    """
    begin_s = clock()
    limit = TimeLimit(plan.time_limit_s, MIN_LAUNCHES, clock, counts_loading=plan.counts_loading)
    targets = baseline, candidate
    pair = pair_of(pool, targets, plan.sizes, limit, plan.as_shipped)
    rule, ending = launch_until_certain(pair, plan, limit, on_launch)
    if pair.baseline_workload is not None:
        use_workload(pair.baseline_workload)
    as_shipped = None
    if pair.placement is not None and pair.placement.averages:
        as_shipped = _judge_as_shipped(rule.launches, plan, pair.log_scale)
    record = VerdictRecord.of(
        (baseline.row(), candidate.row()),
        plan.sizes.metric,
        ending,
        rule.judgement,
        pair.work,
        pair.results,
        rule.launches,
        clock() - begin_s,
    )
    versions = package_versions(baseline.release, candidate.release)
    return with_placement(replace(record, packages=versions), targets, pair.placement, as_shipped)


def with_placement(
    record: VerdictRecord,
    targets: tuple[Target, Target],
    control: PlacementControl | None,
    as_shipped: Judgement | None,
) -> VerdictRecord:
    """Return a verdict with the effect of where code lies, and with why two builds differ."""
    if control is None or not METRICS[record.metric].follows_placement:
        return record
    effect = None
    if record.ratio is not None and as_shipped is not None:
        effect = as_shipped.ratio.over(record.ratio)
    shipped = as_shipped.ratio if as_shipped else None
    placement = PlacementEffect(control.averages, control.problem, shipped, effect)
    cause = _cause(record, placement, as_shipped) if _are_builds(*targets) else None
    return replace(record, placement=placement, cause=cause)


def _are_builds(baseline: Target, candidate: Target) -> bool:
    """Return whether two targets differ in the build of MuJoCo alone."""
    has_packages = baseline.release.has_packages or candidate.release.has_packages
    return not has_packages and baseline == replace(candidate, release=baseline.release)


def _cause(
    record: VerdictRecord, placement: PlacementEffect, as_shipped: Judgement | None
) -> Cause | None:
    """Return why two builds differ; None where they do not.

    What is called `same` differs by placement if it does so as shipped, and if as shipped it is
    certainly another ratio.
    """
    if record.ratio is None:
        return None
    if record.verdict == Verdict.SAME:
        differs = as_shipped and as_shipped.verdict in (Verdict.FASTER, Verdict.SLOWER)
        is_certain = placement.effect is not None and not placement.effect.covers(1.0)
        return Cause.PLACEMENT if differs and is_certain else None
    if record.verdict == Verdict.INCONCLUSIVE:
        return Cause.UNDECIDED
    if record.changed_work:
        return Cause.WORK
    return Cause.CODE if placement.averaged else Cause.UNDECIDED


def judge_launches(
    launches: Sequence[LaunchRow], plan: VerdictPlan, log_scale: float = 0.0
) -> Judgement | None:
    """Judge launches, with `log_scale` added to their log ratios; None without any."""
    used = [launch for launch in launches if launch.placements.is_moved] or launches
    if not used:
        return None
    residues = [launch.placements.residue for launch in used if launch.placements.is_moved]
    return judge([launch.log_ratio + log_scale for launch in used], plan, residues or None)


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
    return conclude(Evidence(interval, len(launches)), plan)
