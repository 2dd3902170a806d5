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
# A function that takes over less than this share of a difference has no part in the move.
MIN_PART = 0.05


def moved_cost(
    differences: Mapping[str, float],
    changes: Mapping[str, CodeChange],
    calls: Iterable[tuple[str, str]],
    min_cost: float,
) -> list[AbstractSet[str]]:
    """Return groups of functions between which cost moved, the largest first.

    Args:
      differences: instructions per step, candidate minus baseline, by function.
      changes: how the code of each function changed.
      calls: (caller, callee) in either release.
      min_cost: smallest difference to account for, in instructions per step.
    """
    neighbours: dict[str, set[str]] = defaultdict(set)
    for caller, callee in calls:
        # other callers cannot have taken over, or given up, instructions of a callee
        if changes.get(caller) in OTHER_CODE:
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
        if abs(part) >= MIN_PART * abs(total) and abs(rest + part) < abs(rest):
            partners.add(other)
            rest += part
    return partners if abs(rest) <= MAX_REST * abs(total) else set()
