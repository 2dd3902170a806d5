"""Explain why a release is slower: instructions by function and stage, baseline and candidate.

The functions of the two counts are matched: what each executes, and what cost moved. A compiler
that inlines a function moves its instructions to the caller; one that no longer does, or a
programmer who splits a function, moves them out of it. The caller then costs about as much more as
its callee costs less, or the other way round, and neither difference is a change of speed.
"""

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, replace
from pathlib import PurePath

from mjbench.counts.instructions import ModelCount
from mjbench.counts.records import ExplainRecord, FunctionDifference
from mjbench.paired.records import Pair, VerdictRow
from mjbench.simulation import changed_work, state_drift
from mjbench.simulation.state_drift import StateDrift
from mjbench.status import Status

# Two counts of the same work differ by less, as a share (tests/counts/test_instructions.py).
REPEATABILITY = 0.001
# The smallest cost whose move is reported, as a share of a step.
MIN_MOVED = 0.001
# What is left of a difference that moved may be at most this share of it. The rest of the change is
# real: calls that are saved, or code that the compiler optimised better where it is inlined.
MAX_REST = 0.25
# A callee whose cost changed by a smaller share was neither inlined nor split off: both it and its
# caller rather changed for reasons of their own.
MIN_CALLEE_CHANGE = 0.25
# A function that takes over less than this share of a difference has no part in the move.
MIN_PART = 0.05
# Functions without a name in the symbol table: Callgrind writes their address instead.
_UNNAMED = "0x"


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


def function_differences(baseline: ModelCount, candidate: ModelCount) -> list[FunctionDifference]:
    """Return all functions that either release executes, the largest difference first.

    Of equal differences the costliest function comes first. Functions without names are put
    together by their library, because their addresses differ between releases.
    """
    before, after = _self_costs(baseline), _self_costs(candidate)
    functions = {
        name: FunctionDifference(
            name=name,
            old=before.get(name),
            new=after.get(name),
            difference=after.get(name, 0.0) - before.get(name, 0.0),
        )
        for name in {**before, **after}
    }
    min_cost = MIN_MOVED * (candidate.instructions_per_step or 0.0)
    for group in moved_cost(functions, baseline.calls | candidate.calls, min_cost):
        members = sorted((functions[name] for name in group), key=_largest_first)
        for each in members:
            others = [other.name for other in members if other.difference * each.difference < 0]
            functions[each.name] = replace(each, moved_with=others)
    return sorted(functions.values(), key=lambda f: (-abs(f.difference), -(f.new or 0.0), f.name))


def moved_groups(functions: Iterable[FunctionDifference]) -> list[list[FunctionDifference]]:
    moved = {function.name: function for function in functions if function.moved_with}
    groups: list[list[FunctionDifference]] = []
    while moved:
        first = next(iter(moved.values()))
        others = [moved[name] for name in first.moved_with if name in moved]
        names = {first.name, *first.moved_with}.union(*(other.moved_with for other in others))
        groups.append([moved.pop(name) for name in list(moved) if name in names])
    return groups


@dataclass(frozen=True)
class NetDifference:
    """By how much the instructions per step of a function differ, or of some that cost moved in."""

    names: Sequence[str]
    difference: float


def largest_differences(functions: Sequence[FunctionDifference], count: int) -> list[NetDifference]:
    groups = moved_groups(functions)
    moved = {function.name for group in groups for function in group}
    groups += [[function] for function in functions if function.name not in moved]
    net = [NetDifference([f.name for f in g], sum(f.difference for f in g)) for g in groups]
    net = [difference for difference in net if difference.difference]
    return sorted(net, key=lambda d: (-abs(d.difference), d.names))[:count]


def _self_costs(count: ModelCount) -> dict[str, float]:
    """Return what each function executes itself, by name; unnamed ones by library."""
    costs: dict[str, float] = defaultdict(float)
    for function in count.functions:
        name = function.name
        if name.startswith(_UNNAMED):
            library = PurePath(count.libraries.get(name) or "unknown library").name
            name = f"{library.partition('.')[0]} (no symbols)"
        if function.self:
            costs[name] += function.self
    return dict(costs)


def moved_cost(
    functions: Mapping[str, FunctionDifference], calls: Iterable[tuple[str, str]], min_cost: float
) -> list[AbstractSet[str]]:
    """Return groups of functions between which cost moved, by name, the largest first.

    Args:
      min_cost: smallest difference to account for, in instructions per step.
    """
    neighbours: dict[str, set[str]] = defaultdict(set)
    for caller, name in calls:
        callee = functions.get(name)
        if callee is None or caller not in functions:
            continue
        if abs(callee.difference) >= MIN_CALLEE_CHANGE * max(callee.old or 0.0, callee.new or 0.0):
            neighbours[caller].add(name)
            neighbours[name].add(caller)
    groups: list[AbstractSet[str]] = []
    grouped: set[str] = set()
    for function in sorted(functions.values(), key=_largest_first):
        if function.name in grouped or abs(function.difference) < min_cost:
            continue
        others = [functions[name] for name in neighbours[function.name] - grouped]
        partners = _partners(function.difference, others)
        if partners:
            groups.append({function.name, *partners})
            grouped |= groups[-1]
    return groups


def _largest_first(function: FunctionDifference) -> tuple[float, str]:
    return -abs(function.difference), function.name


def _partners(total: float, neighbours: Iterable[FunctionDifference]) -> AbstractSet[str]:
    """Return which neighbours took over a difference, or gave it up; empty if it did not move."""
    rest, partners = total, set()
    for other in sorted(neighbours, key=_largest_first):
        part = other.difference
        is_part = total * part < 0 and abs(part) >= MIN_PART * abs(total)
        if is_part and abs(rest + part) < abs(rest):
            partners.add(other.name)
            rest += part
    return partners if abs(rest) <= MAX_REST * abs(total) else set()
