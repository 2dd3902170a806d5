"""Do two sets of final states agree, and if not, where do they first differ?

Paths that run the same C engine must agree to the last bit, over all of mjSTATE_INTEGRATION.
"""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

# Counters of work that differ by more than this share, of the larger one, are other work.
SAME_WORK = 0.005
# Below this a difference after one step, in SI units, is rounding: the order of additions changed.
ROUNDING = 1e-9


@dataclass(frozen=True)
class Difference:
    """Where states first differ.

    Attributes:
      field: the MjData field.
      index: position within the field.
      simulation: index of the simulation.
      step: number of steps after which it shows, or None if not looked for.
      got: the value found.
      expected: the reference's value.
    """

    field: str
    index: int
    simulation: int
    got: float
    expected: float
    step: int | None = None

    def at(self, step: int) -> "Difference":
        """Return the same difference, seen after `step` steps."""
        return replace(self, step=step)

    def __str__(self) -> str:
        when = "at the end" if self.step is None else f"after step {self.step}"
        if np.isnan(self.got):
            what = "never written"
        else:
            what = f"{self.got!r} instead of {self.expected!r}"
        return f"{self.field}[{self.index}] of simulation {self.simulation} differs {when}: {what}"


def first_difference(
    values: np.ndarray,
    reference: np.ndarray,
    columns: Mapping[str, slice],
    held: np.ndarray | None = None,
) -> Difference | None:
    """Return where `values` first differs from `reference` in any bit, or None.

    First means the lowest simulation, then the first entry of its row.

    Args:
      values: (nbatch, nstate) float64 states.
      reference: (nbatch, nstate) float64 states to compare with.
      columns: where each field stands in a row.
      held: (nbatch, nstate) which entries to compare; None for all.
    """
    if values.shape != reference.shape:
        raise ValueError(f"states of shape {values.shape} against {reference.shape}")
    wrong = _bits(values) != _bits(reference)
    if held is not None:
        wrong &= held
    if not wrong.any():
        return None
    simulation, column = (int(i) for i in np.argwhere(wrong)[0])
    field, start = next(
        (name, where.start) for name, where in columns.items() if column < where.stop
    )
    return Difference(
        field,
        column - start,
        simulation,
        float(values[simulation, column]),
        float(reference[simulation, column]),
    )


def digest(states: np.ndarray) -> str:
    """Return 16 hexadecimal digits that name the states, bit by bit."""
    return hashlib.blake2b(np.ascontiguousarray(states).tobytes(), digest_size=8).hexdigest()


def _bits(states: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(states, dtype=np.float64).view(np.uint64)


def drift(after: Mapping[str, np.ndarray], reference: Mapping[str, np.ndarray]) -> float:
    """Return the largest difference between two results of `work.one_step`, in SI units.

    NaN, where one of them has one, is a difference: infinite.
    """
    largest = 0.0
    for field, values in after.items():
        difference = np.abs(values - reference[field])
        if difference.size:
            largest = max(largest, float(np.where(np.isnan(difference), np.inf, difference).max()))
    return largest


def work_changes(
    old: Mapping[str, float],
    new: Mapping[str, float],
    drift: float | None,
    diverged: tuple[int, int],
) -> list[str]:
    """Return in words how two sides did other work; empty where it was the same.

    Args:
      old: counters per step.
      new: the same of the new side.
      drift: largest difference one step after the same states; None where it cannot be told.
      diverged: simulations that diverged on each side.
    """
    words = counter_changes(old, new)
    if drift is not None and drift > ROUNDING:
        words.append(f"one step differs by {drift:.1g}")
    if diverged[0] != diverged[1]:
        words.append(f"{diverged[1]} simulations diverge instead of {diverged[0]}")
    return words


def counter_changes(old: Mapping[str, float], new: Mapping[str, float]) -> list[str]:
    """Return the counters of work that changed, in words such as `contacts 1 → 5`."""
    return [
        f"{name.replace('_', ' ')} {before:.4g} → {new[name]:.4g}"
        for name, before in old.items()
        if name in new and abs(new[name] - before) > SAME_WORK * max(abs(before), abs(new[name]))
    ]
