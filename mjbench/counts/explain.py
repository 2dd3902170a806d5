"""Explain why a release is slower: instructions by function and stage, baseline and candidate."""

from collections.abc import Callable
from dataclasses import replace

from mjbench.counts import counted_program
from mjbench.counts.function_differences import function_differences
from mjbench.counts.instructions import InstructionCounter, ModelCount
from mjbench.counts.records import ExplainRecord
from mjbench.errors import Failure
from mjbench.interval import Interval
from mjbench.paired import verdict
from mjbench.paired.metrics import METRICS, Metric
from mjbench.paired.records import (
    Judgement,
    Pair,
    TargetRow,
    VerdictRecord,
    VerdictRow,
    WorkDifference,
)
from mjbench.paired.targets import Target
from mjbench.paired.verdict import VerdictPlan
from mjbench.paired.worker_pool import WorkerPool
from mjbench.simulation import changed_work, state_drift
from mjbench.simulation.state_drift import StateDrift
from mjbench.status import Status

# Two counts of the same work differ by less, as a share (tests/counts/test_instructions.py).
REPEATABILITY = 0.001


def explain_change(
    baseline: ModelCount, candidate: ModelCount, time: VerdictRow | None
) -> ExplainRecord:
    failed = next((c for c in (baseline, candidate) if c.status != Status.OK), None)
    functions = function_differences(baseline, candidate)
    before, after = baseline.stages or {}, candidate.stages or {}
    return ExplainRecord(
        model=candidate.model,
        operation=candidate.operation,
        old=baseline.release,
        new=candidate.release,
        status=failed.status if failed else Status.OK,
        instructions_per_step=Pair(baseline.instructions_per_step, candidate.instructions_per_step),
        outside_per_step=Pair(baseline.outside_per_step, candidate.outside_per_step),
        work=Pair(baseline.work, candidate.work),
        stages={
            stage: Pair(before.get(stage, 0.0), after.get(stage, 0.0))
            for stage in {**before, **after}
        },
        functions=[function for function in functions if function.difference],
        time=time,
    )


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


def decide_targets(
    pool: WorkerPool,
    baseline: Target,
    candidate: Target,
    plan: VerdictPlan,
    on_launch: Callable[[Judgement], None] = lambda judgement: None,
) -> VerdictRecord:
    """Return the verdict on two targets, from launches or, by an exact metric, from counts."""
    if not METRICS[plan.sizes.metric].is_exact:
        return verdict.decide_pair(pool, baseline, candidate, plan, on_launch)
    with InstructionCounter(plan.sizes) as counter:
        sides = (baseline, candidate)
        old, new = (count for side in sides for count in counter.count(side.release, [side.model]))
    if baseline.model != candidate.model:  # each was stepped from states of its own
        new = replace(new, followed=None)
    return instruction_verdict(old, new, plan.min_effect)


def _work(baseline: ModelCount, candidate: ModelCount) -> WorkDifference:
    return WorkDifference(
        baseline.work,
        candidate.work,
        _drift(baseline, candidate),
        (baseline.diverged, candidate.diverged),
        (baseline.warnings or {}, candidate.warnings or {}),
    )


def _drift(baseline: ModelCount, candidate: ModelCount) -> StateDrift | None:
    if baseline.followed is None or candidate.followed is None:
        return None
    assert baseline.healthy is not None and candidate.healthy is not None, "both were counted"
    healthy = baseline.healthy & candidate.healthy
    return state_drift.drift(baseline.followed, candidate.followed, healthy)


def work_changes(baseline: ModelCount, candidate: ModelCount, time: VerdictRow | None) -> list[str]:
    """Return how the work of the two differs, for people; empty where it is the same.

    Where time was compared, single steps were compared with it; they are counted without otherwise.
    """
    drift = _drift(baseline, candidate)
    one_step = drift.one_step if drift else None
    if time is not None and time.drift is not None:
        one_step = max(one_step or 0.0, time.drift)
    return changed_work.work_changes(
        baseline.work, candidate.work, one_step, (baseline.diverged, candidate.diverged)
    )


def _ratio(baseline: ModelCount, candidate: ModelCount) -> Interval | None:
    if not baseline.instructions_per_step or not candidate.instructions_per_step:
        return None
    estimate = candidate.instructions_per_step / baseline.instructions_per_step
    return Interval(estimate, estimate / (1 + REPEATABILITY), estimate * (1 + REPEATABILITY))
