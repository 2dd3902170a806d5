"""The verdict on two targets: from launches or, by the instructions of the engine, from counts."""

from collections.abc import Callable
from dataclasses import replace

from mjbench.counts import counted_program
from mjbench.counts.explain import REPEATABILITY, drift
from mjbench.counts.instructions import InstructionCounter, ModelCount
from mjbench.errors import Failure
from mjbench.interval import Interval
from mjbench.paired import verdict
from mjbench.paired.metrics import METRICS, Metric
from mjbench.paired.records import Judgement, TargetRow, VerdictRecord, WorkDifference
from mjbench.paired.targets import Target
from mjbench.paired.verdict import VerdictPlan
from mjbench.paired.worker_pool import WorkerPool
from mjbench.status import Status


def decide_targets(
    pool: WorkerPool,
    baseline: Target,
    candidate: Target,
    plan: VerdictPlan,
    on_launch: Callable[[Judgement], None] = lambda judgement: None,
) -> VerdictRecord:
    """Return the verdict on two targets; `on_launch` gets what is known after each launch."""
    if not METRICS[plan.sizes.metric].is_exact:
        return verdict.decide_pair(pool, baseline, candidate, plan, on_launch)
    with InstructionCounter(plan.sizes) as counter:
        sides = (baseline, candidate)
        old, new = (count for side in sides for count in counter.count(side.release, [side.model]))
    if baseline.model != candidate.model:  # each was stepped from states of its own
        new = replace(new, followed=None)
    return instruction_verdict(old, new, plan.min_effect)


def instruction_verdict(
    baseline: ModelCount, candidate: ModelCount, min_effect: float
) -> VerdictRecord:
    """Return the verdict on one model, by the instructions of the engine.

    Instructions are exact, so there is no inconclusive verdict; the interval is how far two counts
    of the same work may differ.
    """
    both = (baseline, candidate)
    failed = next((c for c in both if c.status != Status.OK), None)
    ratio = None if failed else _ratio(baseline, candidate)
    details = [f"MuJoCo {c.release}: {c.detail}" for c in both if c.detail]
    old, new = (
        TargetRow(c.release, c.model, counted_program.PATH, {}, {}, build=c.build) for c in both
    )
    return VerdictRecord.of(
        (old, new),
        Metric.INSTRUCTIONS,
        Failure(failed.status if failed else Status.OK, "; ".join(details)),
        verdict.judge_exactly(ratio, min_effect) if ratio else None,
        _work(baseline, candidate),
        seconds=baseline.seconds + candidate.seconds,
    )


def _work(baseline: ModelCount, candidate: ModelCount) -> WorkDifference:
    return WorkDifference(
        baseline.work,
        candidate.work,
        drift(baseline, candidate),
        (baseline.diverged, candidate.diverged),
        (baseline.warnings or {}, candidate.warnings or {}),
    )


def _ratio(baseline: ModelCount, candidate: ModelCount) -> Interval | None:
    if not baseline.instructions_per_step or not candidate.instructions_per_step:
        return None
    estimate = candidate.instructions_per_step / baseline.instructions_per_step
    return Interval(estimate, estimate / (1 + REPEATABILITY), estimate * (1 + REPEATABILITY))
