"""Compare states, bit by bit and within tolerances.

Paths that run the same C engine must agree to the last bit, over all of mjSTATE_INTEGRATION.
Engines that compile the step, MJX and Warp, are judged part by part: see
`accelerated_judgement`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from mjbench.simulation import compat

# Differences are relative to the largest magnitude of their field, but never to less than this, in
# SI units: where a model rests, velocities are rounding themselves.
LEAST_SCALE = 1e-3


@dataclass(frozen=True)
class Difference:
    """The first entry in which states differ, and the step after which it first shows, if known.

    Attributes:
      is_reordered: whether the difference shows only after the simulations were reordered.
    """

    field: str
    index: int
    simulation: int
    got: float
    expected: float
    step: int | None = None
    is_reordered: bool = False

    def at(self, step: int) -> "Difference":
        return replace(self, step=step)

    def __str__(self) -> str:
        when = "at the end" if self.step is None else f"after step {self.step}"
        is_empty = np.isnan(self.got)
        values = "never written" if is_empty else f"{self.got!r} instead of {self.expected!r}"
        entry = f"{self.field}[{self.index}] of simulation {self.simulation}"
        order = " once the simulations are reordered" if self.is_reordered else ""
        return f"{entry} differs {when}{order}: {values}"


def first_differing_entry(
    values: np.ndarray,
    reference: np.ndarray,
    columns: Mapping[str, slice],
    mask: np.ndarray | None = None,
) -> Difference | None:
    """Return the first entry that differs in any bit of two arrays of (nbatch, nstate) states.

    First means the lowest simulation, then the first entry of its row.

    Raises:
      ValueError: the shapes differ.
    """
    if values.shape != reference.shape:
        raise ValueError(f"states of shape {values.shape} against {reference.shape}")
    differs = _bits(values) != _bits(reference)
    if mask is not None:
        differs &= mask
    if not differs.any():
        return None
    simulation, column = (int(i) for i in np.argwhere(differs)[0])
    field, place = next(item for item in columns.items() if column < item[1].stop)
    got, expected = (float(states[simulation, column]) for states in (values, reference))
    return Difference(field, column - place.start, simulation, got, expected)


def first_differing_step(
    values: np.ndarray, reference: np.ndarray, columns: Mapping[str, slice]
) -> Difference | None:
    """Return what `first_differing_entry` does, of the earliest step of (nbatch, nstep, n) outputs.

    Raises:
      ValueError: the shapes differ.
    """
    if values.shape != reference.shape:
        raise ValueError(f"outputs of shape {values.shape} against {reference.shape}")
    differs = _bits(values) != _bits(reference)
    if not differs.any():
        return None
    step = int(np.argmax(differs.any(axis=(0, 2))))
    difference = first_differing_entry(
        np.ascontiguousarray(values[:, step]), np.ascontiguousarray(reference[:, step]), columns
    )
    assert difference is not None, "this step differs"
    return difference.at(step + 1)


def _bits(states: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(states, dtype=np.float64).view(np.uint64)


def drift(
    after: Mapping[str, np.ndarray],
    reference: Mapping[str, np.ndarray],
    scales: Mapping[str, float] | None = None,
) -> float:
    """Return the largest difference of any field, in units of its scale; infinite for a NaN."""
    largest = 0.0
    for field, values in after.items():
        difference = np.abs(values - reference[field])
        if difference.size:
            most = float(np.where(np.isnan(difference), np.inf, difference).max())
            largest = max(largest, most / scales[field] if scales else most)
    return largest


def field_scales(fields: Mapping[str, np.ndarray]) -> dict[str, float]:
    """Return the scale of each field: its largest finite magnitude, at least LEAST_SCALE."""
    return {
        field: max(LEAST_SCALE, float(np.abs(values[np.isfinite(values)]).max(initial=0.0)))
        for field, values in fields.items()
    }


def max_relative_error(
    got: Mapping[str, np.ndarray], want: Mapping[str, np.ndarray], names: Sequence[str]
) -> np.ndarray:
    """Return (n,) the largest difference of any entry of (n, size) fields that both have.

    A difference is relative to the largest entry of its field in that row, where that exceeds 1.
    NaN and infinity count as the largest float, because JSON has neither.
    """
    largest = np.zeros(len(next(iter(want.values()))))
    for name in names:
        if name in want and name in got and want[name].shape[1]:
            scale = np.maximum(1.0, np.abs(want[name]).max(axis=1, keepdims=True))
            difference = np.abs(got[name] - want[name]) / scale
            limit = np.finfo(float).max
            finite = np.nan_to_num(difference, nan=limit, posinf=limit)
            largest = np.maximum(largest, finite.max(axis=1))
    return largest


class StateReader:
    """Reads states of simulations of one model, and compares them."""

    def __init__(self, model: mujoco.MjModel):
        self.spec = compat.INTEGRATION
        self.columns = compat.state_columns(model)
        self.nstate = compat.state_size(model)
        ctrl = self.columns.get("ctrl", slice(self.nstate, self.nstate))
        self._before_ctrl, self._after_ctrl = slice(ctrl.start), slice(ctrl.stop, None)

    def read(self, model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
        """Return (nstate,) the state of a simulation now."""
        state = np.empty(self.nstate)
        compat.get_state(model, data, state)
        return state

    def differing(self, state: np.ndarray, other: np.ndarray) -> set[str]:
        """Return the MjData fields, other than the controls, that differ in any bit."""
        before, after = self._before_ctrl, self._after_ctrl
        if (
            state[before].tobytes() == other[before].tobytes()
            and state[after].tobytes() == other[after].tobytes()
        ):
            return set()
        return {
            field
            for field, place in self.columns.items()
            if field != "ctrl" and state[place].tobytes() != other[place].tobytes()
        }
