"""The reference run, step by step: other engines' single steps are compared with it.

`single_steps` takes one step in C from each of some recorded states, and records whether a contact
or another constraint acted. The *shadow* is the same run with every state rounded to float32: an
engine that computes in float32 is expected to differ from C by about as much as the shadow does.
"""

import copy
from collections.abc import Callable, Collection
from dataclasses import dataclass

import mujoco
import numpy as np

from mjbench.simulation import compat
from mjbench.simulation.contacts import Contacts
from mjbench.simulation.input_probe import set_inputs
from mjbench.simulation.workload import Workload

# Fields by which states are compared: the physics, without warm-starts and time.
COMPARED = ("qpos", "qvel", "act")
# Single steps from states of a run, at most.
MAX_SINGLE_STEPS = 256


@dataclass(frozen=True, eq=False)
class SingleSteps:
    """Single steps of the reference engine: (n, nstate) states before and after each.

    Attributes:
      constraints: (n,) scalar constraints.
    """

    state: np.ndarray
    control: np.ndarray
    after: np.ndarray
    contacts: Contacts
    constraints: np.ndarray


@dataclass(frozen=True, eq=False)
class Trajectory:
    """All states of some simulations, evenly spread over the batch.

    Attributes:
      simulation: (n,) indices.
      states: (n, nstep + 1, nstate), with the start.
      unconstrained_nstep: steps before the first on which a constraint acted in any simulation;
        nstep if there was none.
    """

    simulation: np.ndarray
    states: np.ndarray
    unconstrained_nstep: int


def record_trajectory(
    workload: Workload, nsim: int, change: Callable[[np.ndarray], np.ndarray] | None = None
) -> Trajectory:
    """Run at most `nsim` simulations in C, with the first and the last; return all their states.

    Args:
      change: changes states and controls before every step, for a shadow.
    """
    model, data = workload.model, mujoco.MjData(workload.model)
    nstep = workload.nstep
    chosen = spread_indices(workload.nbatch, nsim)
    states = np.empty((len(chosen), nstep + 1, workload.initial_state.shape[1]))
    unconstrained_nstep = nstep
    for i, simulation in enumerate(chosen):
        mujoco.mj_resetData(model, data)
        states[i, 0] = workload.initial_state[simulation]
        for k in range(nstep):
            if k == 0 or change:
                before = change(states[i, k]) if change else states[i, k]
                compat.set_state(model, data, before)
            ctrl = workload.control[simulation, k // workload.hold]
            data.ctrl[:] = change(ctrl) if change else ctrl
            mujoco.mj_step(model, data)
            if data.nefc or data.ncon:
                unconstrained_nstep = min(unconstrained_nstep, k)
            compat.get_state(model, data, states[i, k + 1])
    return Trajectory(chosen, states, unconstrained_nstep)


def single_steps(
    workload: Workload,
    trajectory: Trajectory,
    max_count: int,
    rounded: bool,
    inputs_to_set: Collection[str] = (),
) -> SingleSteps:
    """Take single steps in C from states of a run, evenly spread over it.

    In a random half of them the inputs that other engines have, too, get non-trivial values
    (see `input_probe`): an engine that drops one takes another step.

    Args:
      rounded: round states and controls to float32 first, as an engine in float32 does.
    """
    nstep = workload.nstep
    chosen = spread_indices(len(trajectory.states) * nstep, max_count)
    row, step = chosen // nstep, chosen % nstep
    state = trajectory.states[row, step]
    control = workload.control[trajectory.simulation[row], step // workload.hold]
    if inputs_to_set:
        # every second one would be of the second half of the run alone, if each run has two
        drawn = np.random.default_rng([workload.seed, 9]).permutation(len(state))
        rows = np.sort(drawn[: len(state) // 2])
        state[rows] = set_inputs(workload.model, state[rows], workload.seed, inputs_to_set)
    if rounded:
        state, control = as_float32(state), as_float32(control)
    return take_steps(workload.model, np.ascontiguousarray(state), control)


def take_steps(model: mujoco.MjModel, state: np.ndarray, control: np.ndarray) -> SingleSteps:
    data, after = mujoco.MjData(model), np.empty_like(state)
    constraints, contacts = np.zeros(len(state), dtype=int), []
    for i in range(len(state)):
        compat.restart(model, data, state[i])
        data.ctrl[:] = control[i]
        mujoco.mj_step(model, data)
        compat.get_state(model, data, after[i])
        constraints[i] = data.nefc
        contacts.append([copy.copy(each) for each in data.contact[: data.ncon]])
    return SingleSteps(state, control, after, Contacts.of_c(contacts), constraints)


def spread_indices(count: int, max_count: int) -> np.ndarray:
    """Return up to `max_count` of `count` indices, evenly spread from the first to the last."""
    return np.unique(np.linspace(0, count - 1, min(max_count, count)).astype(int))


def as_float32(values: np.ndarray) -> np.ndarray:
    return values.astype(np.float32).astype(np.float64)
