"""Tell cost that moved between functions from cost that is new, or was saved.

A compiler that inlines a function moves its instructions to the caller; one that no longer does, or
a programmer who splits a function, moves them out of it. The caller's code has then changed, it
costs about as much more as its callee costs less, or the other way round, and neither difference is
a change of speed.
"""

from collections import defaultdict
from collections.abc import Iterable, Mapping
from collections.abc import Set as AbstractSet

from mjbench.counts.records import OTHER_CODE, CodeChange

# What is left of a difference that moved may be at most this share of it. The rest of the change is
# real: calls that are saved, or code that the compiler optimised better where it is inlined.
MAX_REST = 0.25
# A callee whose cost changed by a smaller share was neither inlined nor split off: both it and its
# caller rather changed for reasons of their own.
MIN_CALLEE_CHANGE = 0.25
# A function that takes over less than this share of a difference has no part in the move.
MIN_PART = 0.05


def moved_cost(
    costs: Mapping[str, tuple[float, float]],
    changes: Mapping[str, CodeChange],
    calls: Iterable[tuple[str, str]],
    min_cost: float,
) -> list[AbstractSet[str]]:
    """Return groups of functions between which cost moved, the largest first.

    Args:
      costs: instructions per step that each function executes itself: (baseline, candidate).
      changes: how the code of each function changed.
      calls: (caller, callee) in either release.
      min_cost: smallest difference to account for, in instructions per step.
    """
    differences = {name: after - before for name, (before, after) in costs.items()}
    neighbours: dict[str, set[str]] = defaultdict(set)
    for caller, callee in calls:
        largest = max(costs.get(callee, (0.0,)))
        is_large = abs(differences.get(callee, 0.0)) >= MIN_CALLEE_CHANGE * largest
        # other callers cannot have taken over, or given up, instructions of a callee
        if changes.get(caller) in OTHER_CODE and is_large:
            neighbours[caller].add(callee)
            neighbours[callee].add(caller)
    groups: list[AbstractSet[str]] = []
    grouped: set[str] = set()
    for name in sorted(differences, key=lambda name: (-abs(differences[name]), name)):
        if name in grouped or abs(differences[name]) < min_cost:
            continue
        partners = _partners(name, neighbours[name] - grouped, differences)
        if partners:
            groups.append({name, *partners})
            grouped |= groups[-1]
    return groups


def _partners(
    name: str, neighbours: Iterable[str], differences: Mapping[str, float]
) -> AbstractSet[str]:
    """Return the functions that took over a function's cost or gave it up; empty if it changed."""
    total = rest = differences[name]
    partners = set()
    for other in sorted(neighbours, key=lambda n: (-abs(differences.get(n, 0.0)), n)):
        part = differences.get(other, 0.0)
        is_part = total * part < 0 and abs(part) >= MIN_PART * abs(total)
        if is_part and abs(rest + part) < abs(rest):
            partners.add(other)
            rest += part
    return partners if abs(rest) <= MAX_REST * abs(total) else set()
