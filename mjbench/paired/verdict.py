"""Decide which of two targets is faster: launch them until the verdict is certain.

`judge` decides from the launches so far; `decide` launches until it has enough.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace

from mjbench.errors import MachineError
from mjbench.measuring import anytime
from mjbench.measuring.anytime import Evidence
from mjbench.measuring.progress import Progress
from mjbench.measuring.ratio import Ratio
from mjbench.paired import outcomes
from mjbench.paired.judgement import MIN_LAUNCHES, Judgement, conclude, judge, judge_exact
from mjbench.paired.metrics import METRICS, Metric
from mjbench.paired.moved_check import Averaging, averaging
from mjbench.paired.outcomes import Cause, Verdict
from mjbench.paired.pair_rule import Launched, PairRule, Sufficiency
from mjbench.paired.preparation import WorkCheck
from mjbench.paired.records import (
    MAX_E_VALUE,
    LaunchRow,
    PackageVersions,
    Pair,
    PlacementEffect,
    TargetRow,
    VerdictRecord,
    VerdictRow,
)
from mjbench.paired.run_sizes import Sizes
from mjbench.paired.targets import Target
from mjbench.paired.worker_pool import WorkerPool
from mjbench.releases import installs
from mjbench.releases.installs import ReleaseSpec
from mjbench.releases.placement import PlacementPair
from mjbench.status import Status
from mjbench.units import percent_change

# Unless another is asked for.
CONFIDENCE = outcomes.CONFIDENCE
# After as many launches, a comparison shows half of its work as done.
_HALFWAY_LAUNCHES = 15


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
    confidence: float = CONFIDENCE
    precision: float = outcomes.PRECISION
    time_limit_s: float = outcomes.TIME_LIMIT_S
    sizes: Sizes = field(default_factory=Sizes)
    as_shipped: bool = False
    family: int = 1


@dataclass(frozen=True, eq=False, kw_only=True)
class PairedResult(Launched):
    """How a comparison ended.

    Attributes:
      judgement: of the launches that moved them, or of all if none did; None without any.
    """

    baseline: Target
    candidate: Target
    metric: Metric = Metric.TIME
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


class _VerdictRule(PairRule):
    """Launch until the verdict is certain; `averaging` is None until it is known."""

    purpose = "a verdict"

    def __init__(
        self,
        pool: WorkerPool,
        targets: tuple[Target, Target],
        plan: VerdictPlan,
        on_launch: Callable[[Judgement], None] = lambda judgement: None,
        clock: Callable[[], float] = time.monotonic,
    ):
        super().__init__(pool, targets, plan.sizes, plan.time_limit_s, clock)
        self._plan, self._on_launch = plan, on_launch
        self._releases = targets[0].release, targets[1].release
        self.averaging: Averaging | None = None

    def placements(self, pool: WorkerPool) -> Iterator[PlacementPair]:
        spec = METRICS[self._plan.sizes.metric]
        as_shipped = self._plan.as_shipped or not spec.follows_placement
        self.averaging = Averaging(False) if as_shipped else averaging(pool, *self._releases)
        return self.averaging.placements()

    def min_launches(self) -> int:
        assert self.averaging is not None, "`placements` is called first"
        if METRICS[self._plan.sizes.metric].is_exact:
            return 1
        return self.averaging.launches_with(MIN_LAUNCHES)

    def look(self, launches: Sequence[LaunchRow]) -> Sufficiency:
        work = self._pair.work
        log_scale = _log_scale(work.work_check if work else None, self._plan)
        judgement = judge_launches(launches, self._plan, log_scale)
        assert judgement is not None, "there is a launch"
        self._on_launch(judgement)
        return Sufficiency(judgement.enough, judgement.launches >= MIN_LAUNCHES)


class _CountedRule(_VerdictRule):
    """Launch until a number of launches can be judged, whatever they say."""

    purpose = "a ratio"

    def __init__(
        self, pool: WorkerPool, targets: tuple[Target, Target], plan: VerdictPlan, count: int
    ):
        super().__init__(pool, targets, plan)
        self._count = count

    def min_launches(self) -> int:
        return self._count

    def look(self, launches: Sequence[LaunchRow]) -> Sufficiency:
        is_enough = len(launches_to_judge(launches)) >= self._count
        return Sufficiency(is_enough, is_enough)


def launch_log_ratios(
    pool: WorkerPool, baseline: Target, candidate: Target, plan: VerdictPlan, count: int
) -> list[float]:
    """Return the log ratios of some launches, whatever they say, as `decide` would judge them."""
    launched = _CountedRule(pool, (baseline, candidate), plan, count).run()
    if launched.status == Status.INTERRUPTED:
        raise KeyboardInterrupt
    if not launched.is_enough:
        raise MachineError(launched.detail)
    log_scale = _log_scale(launched.work_check, plan)
    return [launch.log_ratio + log_scale for launch in launches_to_judge(launched.launches)]


def decide(
    pool: WorkerPool,
    baseline: Target,
    candidate: Target,
    plan: VerdictPlan,
    on_launch: Callable[[Judgement], None] = lambda judgement: None,
    clock: Callable[[], float] = time.monotonic,
) -> PairedResult:
    """Compare two targets until the verdict is certain, or time is up (see `LaunchRule.run`)."""
    rule = _VerdictRule(pool, (baseline, candidate), plan, on_launch, clock)
    launched = rule.run()
    log_scale = _log_scale(launched.work_check, plan)
    has_moved = rule.averaging is not None and rule.averaging.is_on
    return PairedResult(
        **vars(launched),
        baseline=baseline,
        candidate=candidate,
        metric=plan.sizes.metric,
        averaging=rule.averaging,
        judgement=judge_launches(launched.launches, plan, log_scale),
        as_shipped=(_judge_as_shipped(launched.launches, plan, log_scale) if has_moved else None),
    )


def sides_key(sides: Sequence[TargetRow]) -> str:
    return repr([asdict(side) for side in sides])


def completed_share(launches: int) -> float:
    return 1 - 1 / (1 + launches / _HALFWAY_LAUNCHES)


def decide_each(
    pool: WorkerPool,
    pairs: Sequence[tuple[Target, Target]],
    plan: VerdictPlan,
    earlier: Sequence[VerdictRecord],
    on_progress: Progress,
) -> Iterator[PairedResult]:
    """Yield the verdict on each pair but those of `earlier`; the last may be interrupted."""
    done = {sides_key(record.sides) for record in earlier}
    for number, (baseline, candidate) in enumerate(pairs):
        if sides_key([baseline.row(), candidate.row()]) in done:
            continue
        name = f"{candidate.model.name}, MuJoCo {candidate.release.version}"

        def on_launch(judgement: Judgement, number: int = number, name: str = name) -> None:
            text = f"{name} {percent_change(judgement.ratio.estimate)} %"
            on_progress(text, (number + completed_share(judgement.launches)) / len(pairs))

        result = decide(pool, baseline, candidate, plan, on_launch)
        yield result
        if result.status == Status.INTERRUPTED:
            return


def _log_scale(work_check: WorkCheck | None, plan: VerdictPlan) -> float:
    """Return what turns log ratios of the time of a step into those that are judged.

    Where timesteps differ, they are of the time of a simulated second; not the slowest steps, which
    have to keep up with a rate.
    """
    if work_check is None or plan.sizes.metric != Metric.TIME:
        return 0.0
    return work_check.log_scale


def launches_to_judge(launches: Sequence[LaunchRow]) -> Sequence[LaunchRow]:
    """Return the launches in which code was moved, or all if it never was."""
    return [launch for launch in launches if launch.placements.is_moved] or launches


def judge_launches(
    launches: Sequence[LaunchRow], plan: VerdictPlan, log_scale: float = 0.0
) -> Judgement | None:
    """Judge launches, with `log_scale` added to their log ratios; None without any."""
    used = launches_to_judge(launches)
    if not used:
        return None
    if METRICS[plan.sizes.metric].is_exact:
        return judge_exact(used[0].log_ratio, plan.min_effect)
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
    interval = anytime.interval_beside(
        [launch.log_ratio + log_scale for launch in shipped],
        plan.confidence,
        [launch.log_ratio + log_scale for launch in moved],
        [launch.placements.residue for launch in moved],
    )
    return conclude(Evidence(interval, 1.0, 1.0), plan.min_effect, plan.confidence, plan.precision)
