"""Explain why a release is slower: instructions by function and stage, baseline and candidate."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from mjbench.counts import counted_program
from mjbench.counts.function_differences import (
    CodeChanges,
    code_shares,
    function_differences,
    is_different,
    moved_groups,
)
from mjbench.counts.instructions import InstructionCounter, ModelCount
from mjbench.counts.records import (
    OTHER_CODE,
    CodeChange,
    CodeShare,
    ExplainRecord,
)
from mjbench.errors import MachineError
from mjbench.measuring.ratio import Ratio
from mjbench.paired.metrics import Metric
from mjbench.paired.records import Pair, TargetRow, VerdictRecord, VerdictRow
from mjbench.paired.verdict import exact_verdict
from mjbench.releases.installs import ReleaseSpec
from mjbench.simulation import agreement, work_check
from mjbench.simulation.models import ModelSource
from mjbench.simulation.work_check import StateDrift
from mjbench.status import Status
from mjbench.units import percent_change

# Two counts of the same work differ by less, as a share (tests/counts/test_instructions.py).
REPEATABILITY = 0.001
# Ratios of time and of instructions that differ by more have a cause that instructions do not show.
DISAGREEMENT = 0.03


def summary(baseline: ModelCount, candidate: ModelCount, row: ExplainRecord) -> list[str]:
    """Return what changed, a line each: first by how much, then in what."""
    old, new = baseline.instructions_per_step, candidate.instructions_per_step
    assert old and new, "both were counted"
    ratio = new / old
    changes = _work_changes(baseline, candidate, row.time)
    counts = f"instructions per step {old:,.0f} → {new:,.0f} ({percent_change(ratio)} %)"
    time = row.time
    lines = [
        f"{_describe_time(time, time.ratio)}; {counts}" if time and time.ratio else counts,
        "changed work: " + ", ".join(changes) if changes else "same work",
    ]
    return lines + _code_lines(row) + (_time_lines(time, ratio) if time else [])


def _code_lines(row: ExplainRecord) -> list[str]:
    if row.code is None:
        return [f"machine code not compared: {row.code_detail}"]
    details = ", ".join(
        f"{change} {share.functions} ({100 * share.share:.1f} %)"
        for change, share in row.code.items()
    )
    lines = [f"{_code_conclusion(row.code)}: {details}"]
    for group in moved_groups(row.functions):
        parts = " and ".join(f"{each.name} ({each.difference:+,.0f})" for each in group)
        total = sum(each.difference for each in group)
        lines.append(f"cost moved between {parts}, together {total:+,.0f}")
    return lines


def _code_conclusion(code: Mapping[CodeChange, CodeShare]) -> str:
    total = sum(share.functions for share in code.values())
    changed = [share for change, share in code.items() if change in OTHER_CODE]
    unknown = code.get(CodeChange.UNKNOWN, CodeShare(0, 0.0))
    if changed:
        functions = sum(share.functions for share in changed)
        cost = 100 * sum(share.share for share in changed)
        return (
            f"code changed in {functions} of {total} executed functions,"
            f" which execute {cost:.1f} % of the instructions"
        )
    if unknown.share > REPEATABILITY:
        return (
            f"code changed in none of {total} executed functions, as far as it is known"
            f" (unknown for {100 * unknown.share:.1f} % of the instructions)"
        )
    return (
        f"code changed in none of {total} executed functions,"
        " so a difference in time has another cause, such as memory layout"
    )


def _describe_time(time: VerdictRow, ratio: Ratio) -> str:
    interval = "interval unknown"
    if ratio.low is not None and ratio.high is not None:
        interval = f"{percent_change(ratio.low)} to {percent_change(ratio.high)}"
    return f"{time.verdict}, time {percent_change(ratio.estimate)} % ({interval})"


def _time_lines(time: VerdictRow, instruction_ratio: float) -> list[str]:
    lines = [] if time.status == Status.OK else [f"time not compared: {time.detail}"]
    if time.ratio is None or time.ratio.low is None or time.ratio.high is None:
        return lines
    difference = abs(time.ratio.estimate - instruction_ratio)
    low, high = time.ratio.low - DISAGREEMENT, time.ratio.high + DISAGREEMENT
    if difference > DISAGREEMENT and not low <= instruction_ratio <= high:
        lines.append(
            f"time and instructions disagree by {100 * difference:.1f} points: instruction counts"
            " do not show cache misses, mispredicted branches, wider or slower instructions (SIMD,"
            " division), memory allocation in the kernel, and system calls"
        )
    return lines


def explain_change(
    baseline: ModelCount, candidate: ModelCount, time: VerdictRow | None
) -> ExplainRecord:
    failed = next((c for c in (baseline, candidate) if c.status != Status.OK), None)
    code, code_detail = None, "" if failed is None else "a release was not counted"
    if failed is None:
        try:
            code = _code_changes(baseline, candidate)
        except MachineError as error:
            code_detail = str(error)
    functions = function_differences(baseline, candidate, code)
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
        functions=[function for function in functions if is_different(function)],
        code=code_shares(functions) if code else None,
        code_detail=code_detail,
        time=time,
    )


def _code_changes(baseline: ModelCount, candidate: ModelCount) -> CodeChanges:
    from mjbench.counts.code_comparison import compare  # late: Capstone takes long to import

    return compare(baseline.places, candidate.places)


def verdict_row(baseline: ModelCount, candidate: ModelCount, min_effect: float) -> VerdictRow:
    """Return one model's row of `mjbench versions --metric instructions --json`.

    Instructions are exact, so there is no inconclusive verdict; the interval is how far two counts
    of the same work may differ.
    """
    failed = next((c for c in (baseline, candidate) if c.status != Status.OK), None)
    ratio = None if failed else _ratio(baseline, candidate)
    work = None
    if not failed and baseline.work and candidate.work:
        work = Pair(baseline.work, candidate.work)
    drift = state_drift(baseline, candidate)
    details = [f"MuJoCo {c.release}: {c.detail}" for c in (baseline, candidate) if c.detail]
    path = counted_program.PATH
    return VerdictRow(
        model=candidate.model,
        path=path,
        metric=Metric.INSTRUCTIONS,
        old=baseline.release,
        new=candidate.release,
        sides=[
            TargetRow(c.release, c.model, path, options={}, model_options={}, build=c.build)
            for c in (baseline, candidate)
        ],
        status=failed.status if failed else Status.OK,
        detail="; ".join(details),
        verdict=exact_verdict(ratio.estimate, min_effect) if ratio else None,
        ratio=ratio,
        changed_work=None if failed else bool(_work_changes(baseline, candidate, None)),
        work=work,
        drift=drift.one_step if drift else None,
        run_drift=drift.runs if drift else (),
        diverged=Pair(baseline.diverged, candidate.diverged),
        warnings=Pair(baseline.warnings or {}, candidate.warnings or {}),
        seconds=baseline.seconds + candidate.seconds,
    )


def state_drift(baseline: ModelCount, candidate: ModelCount) -> StateDrift | None:
    if baseline.followed is None or candidate.followed is None:
        return None
    assert baseline.healthy is not None and candidate.healthy is not None, "both were counted"
    healthy = baseline.healthy & candidate.healthy
    return work_check.drift(baseline.followed, candidate.followed, healthy)


def _ratio(baseline: ModelCount, candidate: ModelCount) -> Ratio | None:
    if not baseline.instructions_per_step or not candidate.instructions_per_step:
        return None
    estimate = candidate.instructions_per_step / baseline.instructions_per_step
    return Ratio(estimate, estimate / (1 + REPEATABILITY), estimate * (1 + REPEATABILITY))


def _work_changes(
    baseline: ModelCount, candidate: ModelCount, time: VerdictRow | None
) -> list[str]:
    """Return how the work of the two differs, for people; empty where it is the same.

    Where time was compared, single steps were compared with it; they are counted without otherwise.
    """
    drift = state_drift(baseline, candidate)
    one_step = drift.one_step if drift else None
    if time is not None and time.drift is not None:
        one_step = max(one_step or 0.0, time.drift)
    return agreement.work_changes(
        baseline.work, candidate.work, one_step, (baseline.diverged, candidate.diverged)
    )


@dataclass(frozen=True)
class InstructionComparison:
    """What is counted: models in an old release, and in new ones."""

    baseline: ReleaseSpec
    candidates: Sequence[ReleaseSpec]
    sources: Sequence[ModelSource]
    min_effect: float


def verdicts(
    comparison: InstructionComparison,
    counter: InstructionCounter,
    stored: Sequence[VerdictRecord] = (),
    on_candidate: Callable[[int], None] = lambda number: None,
) -> Iterator[VerdictRecord]:
    """Yield the verdict on each model in each new release.

    `on_candidate` is called with the position of a release before its models are counted.
    """
    baselines: dict[str, ModelCount] = {}
    for number, candidate in enumerate(comparison.candidates):
        on_candidate(number)
        finished = {r.model: r for r in stored if r.sides[1].build == candidate.key}
        yield from finished.values()
        missing = [source for source in comparison.sources if source.name not in finished]
        new = [source for source in missing if source.name not in baselines]
        for count in counter.count(comparison.baseline, new) if new else ():
            baselines[count.model] = count
        for count in counter.count(candidate, missing) if missing else ():
            row = verdict_row(baselines[count.model], count, comparison.min_effect)
            yield VerdictRecord(**vars(row))
