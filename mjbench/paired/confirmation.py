"""Compare two paths of `mjbench compare` again, in fresh processes, before one is advised.

Within one process, where its memory happens to lie moves a ratio by a percent or more. Here each
launch has processes of its own, so the interval includes what differs from process to process.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from mjbench.comparison.plan import ComparisonPlan, Variant
from mjbench.instrument.bounds import NonNegativeInt, PositiveInt
from mjbench.paired import verdict
from mjbench.paired.judgement import Judgement
from mjbench.paired.records import LaunchRow, Ratio
from mjbench.paired.run_sizes import THREADED_RUN_S, Sizes
from mjbench.paired.targets import Target
from mjbench.paired.verdict import VerdictPlan
from mjbench.paired.worker_pool import WorkerPool
from mjbench.paths.parallelism import nthread
from mjbench.releases import installs
from mjbench.simulation.models import ModelSource
from mjbench.simulation.workload import whole_holds
from mjbench.status import Status

# The difference that decides between a path and a simpler one.
MIN_EFFECT = 0.03
# Of the interval; and the seconds that one comparison takes at most.
CONFIDENCE, TIME_LIMIT_S = 0.95, 20.0


@dataclass(frozen=True, kw_only=True)
class ConfirmationRecord:
    """Two paths on one model, compared again in fresh processes.

    Attributes:
      model: its name.
      nbatch_asked: simulations that the user asked for; None where mjbench chose.
      baseline: name of the one path.
      baseline_options: its options.
      candidate: name of the other path.
      candidate_options: its options.
      status: how the comparison ended.
      detail: one line; empty when ok.
      ratio: the candidate's time over the baseline's, with a 95 % interval; None without one.
      launches: pairs of fresh processes.
      samples: raw times of every launch.
    """

    record_type: ClassVar[str] = "confirmation"
    model: str
    nbatch_asked: PositiveInt | None = None
    baseline: str
    baseline_options: Mapping[str, Any]
    candidate: str
    candidate_options: Mapping[str, Any]
    status: Status
    detail: str = ""
    ratio: Ratio | None = None
    launches: NonNegativeInt = 0
    samples: Sequence[LaunchRow] = ()

    @property
    def sides(self) -> tuple[Variant, Variant]:
        """The two paths, each with its options."""
        return (
            Variant(self.baseline, self.baseline_options),
            Variant(self.candidate, self.candidate_options),
        )


def of_sides(
    records: Sequence[ConfirmationRecord], baseline: Variant, candidate: Variant
) -> ConfirmationRecord | None:
    """Return the record of two paths; None where there is none."""
    return next((record for record in records if record.sides == (baseline, candidate)), None)


@dataclass(frozen=True)
class ComparedSizes:
    """The sizes at which two paths were compared.

    Attributes:
      nbatch: simulations.
      nstep: steps of each.
      step_s: seconds of a step of the plain loop.
    """

    nbatch: int
    nstep: int
    step_s: float

    def shortened(self, nthread: int, hold: int) -> int:
        """Return steps of each simulation, fewer where a block would take long.

        A block of one thread lasts as long as one of several per thread, and not a millisecond as
        that of other comparisons: a call should do about as much as it did before.

        Args:
          nthread: most threads of the two paths.
          hold: steps per control.
        """
        affordable = int(nthread * THREADED_RUN_S / (self.step_s * self.nbatch))
        return min(self.nstep, whole_holds(affordable, hold))

    def of_blocks(self, plan: ComparisonPlan, variants: Sequence[Variant]) -> Sizes:
        """Return the sizes of blocks in fresh processes.

        Args:
          plan: of the comparison.
          variants: that are compared again.
        """
        nstep = self.shortened(max(nthread(each.options) for each in variants), plan.hold)
        return Sizes(self.nbatch, nstep, plan.hold, plan.seed, plan.starts, plan.returns)


def target(source: ModelSource, plan: ComparisonPlan, variant: Variant) -> Target:
    """Return what a fresh process runs for a variant of a comparison."""
    release = installs.parse_release(installs.INSTALLED)
    return Target(release, source, variant.path, variant.options, import_from=plan.import_from)


def compare_again(
    pool: WorkerPool,
    source: ModelSource,
    plan: ComparisonPlan,
    variants: tuple[Variant, Variant],
    compared: ComparedSizes,
    min_effect: float = MIN_EFFECT,
    on_launch: Callable[[Judgement], None] = lambda judgement: None,
) -> ConfirmationRecord:
    """Return how much faster one path is than another, in fresh processes.

    Args:
      pool: starts the processes.
      source: the model.
      plan: of the comparison that the two come from.
      variants: baseline and candidate; C paths.
      compared: sizes of that comparison.
      min_effect: smallest difference that matters.
      on_launch: called after each launch, with what all launches say so far.
    """
    sizes = compared.of_blocks(plan, variants)
    baseline, candidate = (target(source, plan, variant) for variant in variants)
    # one build against itself: its code lies at the same place in both
    verdict_plan = VerdictPlan(
        min_effect, CONFIDENCE, min_effect / 2, TIME_LIMIT_S, sizes, as_shipped=True
    )
    result = verdict.decide(pool, baseline, candidate, verdict_plan, on_launch)
    row = result.row()
    return ConfirmationRecord(
        model=source.name,
        nbatch_asked=plan.nbatch,
        baseline=variants[0].path,
        baseline_options=variants[0].options,
        candidate=variants[1].path,
        candidate_options=variants[1].options,
        status=row.status,
        detail=row.detail,
        ratio=row.ratio,
        launches=row.launches,
        samples=[launch.row() for launch in result.launches],
    )
