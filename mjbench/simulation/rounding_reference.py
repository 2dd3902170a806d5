"""What C does, for an engine that should do the same up to rounding: a run, and single steps.

The *shadow* is C itself, in which every state and control is moved by one unit in the last place
before each step. An engine that only rounds otherwise differs from C by about as much as the shadow
does. In contact, both differences grow from step to step; in a single step, neither can.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mjbench.simulation import agreement, compat, reference_trajectory
from mjbench.simulation.reference_trajectory import COMPARED, MAX_SINGLE_STEPS
from mjbench.simulation.workload import Workload

# Fields of a state that the shadow moves.
_MOVED = ("qpos", "qvel", "act", "qacc_warmstart")


@dataclass(frozen=True, eq=False)
class ReferenceRun:
    """A run of C, and of its shadow.

    Attributes:
      has_reset: whether an MjData must be reset between simulations.
      states: (nstep + 1, nbatch, nstate) rows of mjSTATE_INTEGRATION, with the start.
      unconstrained_nstep: see `Trajectory`.
      shadow: (nstep + 1,) largest difference of the shadow so far (see `differences`).
    """

    columns: Mapping[str, slice]
    has_reset: bool
    control: np.ndarray
    hold: int
    states: np.ndarray
    unconstrained_nstep: int
    shadow: np.ndarray


@dataclass(frozen=True, eq=False)
class ReferenceSteps:
    """Single steps of C from states of a run; in every second one, each input has a value.

    Attributes:
      state: (n, nstate) rows of mjSTATE_INTEGRATION to start from.
      control: (n, nu).
      after: (n, nstate) states after the step.
      is_constrained: (n,) bool: whether a constraint acted.
      shadow: (n,) difference of the shadow's step (see `differences`).
    """

    state: np.ndarray
    control: np.ndarray
    after: np.ndarray
    is_constrained: np.ndarray
    shadow: np.ndarray


@dataclass(frozen=True, eq=False)
class RoundingReference:
    """What C does with a workload, and from states along it."""

    run: ReferenceRun
    steps: ReferenceSteps


def trace(workload: Workload, seed: int) -> RoundingReference:
    model, columns = workload.model, compat.state_columns(workload.model)
    move = _ShadowMove(columns, seed)
    run = reference_trajectory.record_trajectory(workload, workload.nbatch)
    states = np.ascontiguousarray(run.states.swapaxes(0, 1))
    moved_run = reference_trajectory.record_trajectory(workload, workload.nbatch, change=move)
    steps = reference_trajectory.single_steps(workload, run, MAX_SINGLE_STEPS, False, [*columns])
    moved_steps = reference_trajectory.take_steps(model, move(steps.state), move(steps.control))
    is_in_contact = steps.contacts.counts(len(steps.state)) > 0
    return RoundingReference(
        ReferenceRun(
            columns,
            compat.has_sleep(model),
            workload.control,
            workload.hold,
            states,
            run.unconstrained_nstep,
            largest_so_far(moved_run.states.swapaxes(0, 1), states, columns),
        ),
        ReferenceSteps(
            steps.state,
            steps.control,
            steps.after,
            is_in_contact | (steps.constraints > 0),
            differences(moved_steps.after, steps.after, columns),
        ),
    )


def differences(
    states: np.ndarray, reference: np.ndarray, columns: Mapping[str, slice]
) -> np.ndarray:
    """Return (n,) the largest difference of qpos, qvel and act; see `agreement`."""
    got, want = (
        {field: rows[:, columns[field]] for field in COMPARED if field in columns}
        for rows in (states, reference)
    )
    return agreement.max_relative_error(got, want, COMPARED)


def largest_so_far(
    states: np.ndarray, reference: np.ndarray, columns: Mapping[str, slice]
) -> np.ndarray:
    """Return (npoint,) the largest difference up to each of (npoint, nbatch, nstate) points."""
    npoint, nbatch, nstate = reference.shape
    rows = differences(states.reshape(-1, nstate), reference.reshape(-1, nstate), columns)
    largest: np.ndarray = np.maximum.accumulate(rows.reshape(npoint, nbatch).max(axis=1))
    return largest


class _ShadowMove:
    """Moves numbers by one unit in the last place, up or down at random; zeros stay."""

    def __init__(self, columns: Mapping[str, slice], seed: int):
        self._nstate = max(place.stop for place in columns.values())
        self._is_moved = np.zeros(self._nstate, dtype=bool)
        for field in _MOVED:
            if field in columns:
                self._is_moved[columns[field]] = True
        self._rng = np.random.default_rng([seed, 4])

    def __call__(self, values: np.ndarray) -> np.ndarray:
        towards = np.where(self._rng.random(values.shape) < 0.5, -np.inf, np.inf)
        moved = np.where(values == 0, values, np.nextafter(values, towards))
        if values.shape[-1] == self._nstate:
            return np.where(self._is_moved, moved, values)
        return moved
