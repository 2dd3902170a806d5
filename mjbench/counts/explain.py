"""Explain why a release is slower: instructions by function and stage, baseline and candidate."""

from mjbench.counts import counted_program
from mjbench.counts.instructions import ModelCount
from mjbench.counts.records import CountedWorkPair, CountPair, ExplainRow, FunctionDifference
from mjbench.paired.outcomes import Metric, Verdict
from mjbench.paired.records import (
    DivergedPair,
    Ratio,
    TargetRow,
    VerdictRow,
    WarningsPair,
    WorkPair,
)
from mjbench.simulation import agreement, work_check
from mjbench.simulation.work_check import StateDrift
from mjbench.status import Status

# Two counts of the same work differ by less, as a share (tests/counts/test_instructions.py).
REPEATABILITY = 0.001
# Ratios of time and of instructions that differ by more have a cause that instructions do not show.
DISAGREEMENT = 0.03


def function_differences(baseline: ModelCount, candidate: ModelCount) -> list[FunctionDifference]:
    """Return all functions that differ, the largest difference first."""
    before = {function.name: function.self for function in baseline.functions if function.self}
    after = {function.name: function.self for function in candidate.functions if function.self}
    functions = [
        FunctionDifference.of(name, before.get(name), after.get(name))
        for name in {**before, **after}
    ]
    return sorted(
        (f for f in functions if f.difference), key=lambda f: (-abs(f.difference), f.name)
    )


def stage_pairs(baseline: ModelCount, candidate: ModelCount) -> dict[str, tuple[float, float]]:
    """Return the instructions per step of every stage: (baseline, candidate)."""
    before, after = baseline.stages or {}, candidate.stages or {}
    return {stage: (before.get(stage, 0.0), after.get(stage, 0.0)) for stage in {**before, **after}}


def summary(baseline: ModelCount, candidate: ModelCount, time: VerdictRow | None) -> list[str]:
    """Return lines that say what changed: the instructions, the work, or the time alone.

    Args:
      baseline: a model in the old release, counted.
      candidate: the same in the new one.
      time: the paired comparison of time; None where time was not compared.
    """
    assert baseline.instructions_per_step
    assert candidate.instructions_per_step
    ratio = candidate.instructions_per_step / baseline.instructions_per_step
    changes = _work_changes(baseline, candidate)
    lines = [
        f"instructions per step {baseline.instructions_per_step:,.0f} →"
        f" {candidate.instructions_per_step:,.0f} ({_percent(ratio)} %)",
        "changed work: " + ", ".join(changes) if changes else "same work",
    ]
    return lines + (_time_lines(time, ratio) if time else [])


def _time_lines(time: VerdictRow, instruction_ratio: float) -> list[str]:
    """Return what the comparison of time adds to that of instructions."""
    lines = [] if time.status == Status.OK else [f"time not compared: {time.detail}"]
    if time.ratio is None:
        return lines
    estimate, low, high = time.ratio.estimate, time.ratio.low, time.ratio.high
    if low is None or high is None:
        return [*lines, f"time {_percent(estimate)} % (interval unknown), {time.verdict}"]
    interval = f"{_percent(low)} to {_percent(high)}"
    lines.append(f"time {_percent(estimate)} % ({interval}), {time.verdict}")
    difference = abs(estimate - instruction_ratio)
    is_outside = not low - DISAGREEMENT <= instruction_ratio <= high + DISAGREEMENT
    if difference > DISAGREEMENT and is_outside:
        lines.append(
            f"time and instructions disagree by {100 * difference:.1f} points: instruction counts"
            " do not show cache misses, mispredicted branches, wider or slower instructions (SIMD,"
            " division), memory allocation in the kernel, and system calls"
        )
    return lines


def explain_row(baseline: ModelCount, candidate: ModelCount, time: VerdictRow | None) -> ExplainRow:
    """Return one model's row of `mjbench explain --json`.

    Args:
      baseline: a model in the old release.
      candidate: the same in the new one.
      time: the paired comparison of time; None where time was not compared.
    """
    return ExplainRow(
        model=candidate.model,
        old=baseline.release,
        new=candidate.release,
        status=baseline.status if baseline.status != Status.OK else candidate.status,
        instructions_per_step=CountPair(
            baseline.instructions_per_step, candidate.instructions_per_step
        ),
        outside_per_step=CountPair(baseline.outside_per_step, candidate.outside_per_step),
        work=CountedWorkPair(baseline.work, candidate.work),
        stages={
            stage: CountPair(*pair) for stage, pair in stage_pairs(baseline, candidate).items()
        },
        functions=function_differences(baseline, candidate),
        time=time,
    )


def verdict_row(baseline: ModelCount, candidate: ModelCount, min_effect: float) -> VerdictRow:
    """Return one model's row of `mjbench versions --metric instructions --json`.

    Instructions are exact, so there is no inconclusive verdict; the interval is how far two counts
    of the same work may differ.

    Args:
      baseline: a model in the old release.
      candidate: the same in the new one.
      min_effect: smallest change of instructions that matters, such as 0.01.
    """
    failed = next((c for c in (baseline, candidate) if c.status != Status.OK), None)
    ratio = None if failed else _ratio(baseline, candidate)
    work = None
    if not failed and baseline.work and candidate.work:
        work = WorkPair(baseline.work, candidate.work)
    drift = state_drift(baseline, candidate)
    details = [f"MuJoCo {c.release}: {c.detail}" for c in (baseline, candidate) if c.detail]
    return VerdictRow(
        model=candidate.model,
        path=counted_program.PATH,
        metric=Metric.INSTRUCTIONS,
        old=baseline.release,
        new=candidate.release,
        sides=[_target_row(baseline), _target_row(candidate)],
        status=failed.status if failed else Status.OK,
        detail="; ".join(details),
        verdict=_verdict(ratio, min_effect) if ratio else None,
        ratio=ratio,
        changed_work=None if failed else bool(_work_changes(baseline, candidate)),
        work=work,
        drift=drift.one_step if drift else None,
        run_drift=drift.runs if drift else (),
        diverged=DivergedPair(baseline.diverged, candidate.diverged),
        warnings=WarningsPair(baseline.warnings or {}, candidate.warnings or {}),
        seconds=baseline.seconds + candidate.seconds,
    )


def state_drift(baseline: ModelCount, candidate: ModelCount) -> StateDrift | None:
    """Return how far the states of two counts differ; None if it is unknown."""
    if baseline.followed is None or candidate.followed is None:
        return None
    assert baseline.healthy is not None and candidate.healthy is not None, "both were counted"
    return work_check.drift(
        baseline.followed, candidate.followed, baseline.healthy & candidate.healthy
    )


def _target_row(count: ModelCount) -> TargetRow:
    return TargetRow(
        count.release,
        count.model,
        path=counted_program.PATH,
        options={},
        model_options={},
        build=count.build,
    )


def _ratio(baseline: ModelCount, candidate: ModelCount) -> Ratio | None:
    if not baseline.instructions_per_step or not candidate.instructions_per_step:
        return None
    estimate = candidate.instructions_per_step / baseline.instructions_per_step
    return Ratio(estimate, estimate / (1 + REPEATABILITY), estimate * (1 + REPEATABILITY))


def _verdict(ratio: Ratio, min_effect: float) -> Verdict:
    if ratio.estimate >= 1 + min_effect:
        return Verdict.SLOWER
    return Verdict.FASTER if ratio.estimate <= 1 / (1 + min_effect) else Verdict.SAME


def _work_changes(baseline: ModelCount, candidate: ModelCount) -> list[str]:
    """Return how the work of the two differs, for people; empty where it is the same."""
    drift = state_drift(baseline, candidate)
    return agreement.work_changes(
        baseline.work,
        candidate.work,
        drift.one_step if drift else None,
        (baseline.diverged, candidate.diverged),
    )


def _percent(ratio: float) -> str:
    """Return the change that a ratio stands for, in percent, with its sign."""
    return f"{100 * (ratio - 1):+.2f}"
