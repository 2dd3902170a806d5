"""Explain why a release is slower: instructions by function and stage, baseline and candidate."""

from mjbench.counts.function_differences import function_differences
from mjbench.counts.instructions import ModelCount
from mjbench.counts.records import ExplainRecord
from mjbench.paired.records import Pair, VerdictRow
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
        detail=f"MuJoCo {failed.release}: {failed.detail}" if failed else "",
        instructions_per_step=Pair(baseline.instructions_per_step, candidate.instructions_per_step),
        outside_per_step=Pair(baseline.outside_per_step, candidate.outside_per_step),
        work=Pair(baseline.work, candidate.work),
        changes=_work_changes(baseline, candidate, time),
        warnings=Pair(baseline.warnings or {}, candidate.warnings or {}),
        stages={
            stage: Pair(before.get(stage, 0.0), after.get(stage, 0.0))
            for stage in {**before, **after}
        },
        functions=[function for function in functions if function.difference],
        time=time,
    )


def drift(baseline: ModelCount, candidate: ModelCount) -> StateDrift | None:
    if baseline.followed is None or candidate.followed is None:
        return None
    assert baseline.healthy is not None and candidate.healthy is not None, "both were counted"
    healthy = baseline.healthy & candidate.healthy
    return state_drift.drift(baseline.followed, candidate.followed, healthy)


def _work_changes(
    baseline: ModelCount, candidate: ModelCount, time: VerdictRow | None
) -> list[str]:
    """Return how the work of the two differs.

    Where time was compared, single steps were compared with it; they are counted without otherwise.
    """
    drifted = drift(baseline, candidate)
    one_step = drifted.one_step if drifted else None
    if time is not None and time.drift is not None:
        one_step = max(one_step or 0.0, time.drift)
    return changed_work.work_changes(
        baseline.work, candidate.work, one_step, (baseline.diverged, candidate.diverged)
    )
