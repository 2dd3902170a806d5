"""Do two targets do the same work? What is called changed work, in phrases for people."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mjbench.simulation.reference_run import Work

# Counters that differ by more than this share of the larger one mean that the work differs.
SAME_WORK = 0.005
# A smaller difference after one step is rounding: the order of additions changed.
ROUNDING = 1e-9


def work_changes(
    baseline: "Work | None",
    candidate: "Work | None",
    drift: float | None,
    diverged: tuple[int, int],
) -> list[str]:
    """Return how the work of two targets differs, a phrase each; empty if it is the same.

    Args:
      drift: largest relative difference one step after the same states.
      diverged: number of simulations that diverge in the baseline, and in the candidate.
    """
    changes = []
    if baseline is not None and candidate is not None:
        changes += counter_changes(baseline.as_dict(), candidate.as_dict())
    if drift is not None and drift > ROUNDING:
        changes.append(f"one step differs by {drift:.1g} times the largest qpos, qvel or act")
    if diverged[0] != diverged[1]:
        changes.append(f"{diverged[1]} simulations diverge instead of {diverged[0]}")
    return changes


def counter_changes(baseline: Mapping[str, float], candidate: Mapping[str, float]) -> list[str]:
    """Return which counters that both have differ, such as `contacts 1 → 5`."""
    changes = []
    for name, before in baseline.items():
        after = candidate.get(name, before)
        if abs(after - before) > SAME_WORK * max(abs(before), abs(after)):
            changes.append(f"{name.replace('_', ' ')} {_count(before)} → {_count(after)}")
    return changes


def _count(value: float) -> str:
    """Return a mean count to four significant digits; not as `1.235e+04`."""
    return f"{value:.4g}" if value < 9999.5 else f"{value:.0f}"
