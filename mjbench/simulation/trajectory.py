"""The reference run, step by step: what single steps of other engines are held against.

C takes one step from each recorded state, and says whether a contact or another constraint acted.
The shadow is the same run with every state rounded to float32: as far as it strays, so far must
anything that computes in float32 be expected to stray.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from mjbench.simulation import compat
from mjbench.simulation.workload import Workload

# Fields by which states are compared: what physics is, without warm-starts and the clock.
COMPARED = ("qpos", "qvel", "act")


@dataclass(frozen=True, eq=False)
class Contacts:
    """Contacts of the collision that the last step began with, of all simulations in one list.

    Attributes:
      simulation: (ncon,) whose contact it is.
      geom: (ncon, 2) ids of the geoms, the lower one first.
      normal: (ncon, 3) unit normals, from the lower geom to the other.
    """

    simulation: np.ndarray
    geom: np.ndarray
    normal: np.ndarray

    def counts(self, nbatch: int) -> np.ndarray:
        """(nbatch,) contacts of each simulation."""
        return np.bincount(self.simulation, minlength=nbatch)

    def first(self, nbatch: int) -> "Contacts":
        """Return the contacts of the first simulations."""
        kept = self.simulation < nbatch
        return Contacts(self.simulation[kept], self.geom[kept], self.normal[kept])

    @classmethod
    def joined(cls, parts: Sequence["Contacts"], nbatch: int) -> "Contacts":
        """Return the contacts of batches that follow each other."""
        simulation = np.concatenate([p.simulation + i * nbatch for i, p in enumerate(parts)])
        geom = np.concatenate([part.geom for part in parts])
        normal = np.concatenate([part.normal for part in parts])
        return cls(simulation, geom, normal)

    @classmethod
    def of(cls, simulation: Any, geom: Any, normal: Any) -> "Contacts":
        """Return contacts with the lower geom first; rows of a frame's first axis are normals."""
        pairs = np.asarray(geom, dtype=int).reshape(-1, 2)
        normals = np.array(normal, dtype=float).reshape(-1, 3)
        turned = pairs[:, 0] > pairs[:, 1]
        normals[turned] *= -1
        return cls(np.asarray(simulation, dtype=int), np.sort(pairs, axis=1), normals)


@dataclass(frozen=True, eq=False)
class SingleSteps:
    """Single steps of the reference engine.

    Attributes:
      state: (n, nstate) rows of mjSTATE_INTEGRATION to start from.
      control: (n, nu) controls of the step.
      after: (n, nstate) where the step leads.
      contacts: of the step's collision, by row.
      constraints: (n,) scalar constraints of the step.
    """

    state: np.ndarray
    control: np.ndarray
    after: np.ndarray
    contacts: Contacts
    constraints: np.ndarray


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A run of some simulations, spread over the batch.

    Attributes:
      simulation: (n,) which.
      states: (n, nstep + 1, nstate) from the start on.
      free: steps before the first that a contact or another constraint acted on; nstep where none.
    """

    simulation: np.ndarray
    states: np.ndarray
    free: int


def run(workload: Workload, nsim: int, rounded: bool = False) -> Trajectory:
    """Trajectory `nsim` simulations, the first and the last among them, keeping every state.

    Args:
      workload: whose they are.
      nsim: how many; all where there are fewer.
      rounded: round state and controls to float32 before every step: the shadow.
    """
    model, data = workload.model, mujoco.MjData(workload.model)
    spec, nstep = compat.state_spec("INTEGRATION"), workload.nstep
    chosen = _spread(workload.nbatch, nsim)
    states = np.empty((len(chosen), nstep + 1, workload.initial_state.shape[1]))
    free = nstep
    for i, simulation in enumerate(chosen):
        mujoco.mj_resetData(model, data)
        states[i, 0] = workload.initial_state[simulation]
        for k in range(nstep):
            if k == 0 or rounded:
                before = as_float32(states[i, k]) if rounded else states[i, k]
                compat.set_state(model, data, before, spec)
            ctrl = workload.control[simulation, k // workload.hold]
            data.ctrl[:] = as_float32(ctrl) if rounded else ctrl
            mujoco.mj_step(model, data)
            if data.nefc or data.ncon:
                free = min(free, k)
            compat.get_state(model, data, states[i, k + 1], spec)
    return Trajectory(chosen, states, free)


def single_steps(workload: Workload, found: Trajectory, most: int, rounded: bool) -> SingleSteps:
    """Take single steps from states of a run, evenly spread over it.

    Args:
      workload: that was run.
      found: the run.
      most: at most this many.
      rounded: round the states to float32 first, so that both engines start from the same.
    """
    model, data = workload.model, mujoco.MjData(workload.model)
    spec = compat.state_spec("INTEGRATION")
    nstep = workload.nstep
    chosen = _spread(len(found.states) * nstep, most)
    row, step = chosen // nstep, chosen % nstep
    state = found.states[row, step]
    control = workload.control[found.simulation[row], step // workload.hold]
    if rounded:
        state, control = as_float32(state), as_float32(control)
    state = np.ascontiguousarray(state)
    after = np.empty_like(state)
    constraints = np.zeros(len(chosen), dtype=int)
    rows: list[int] = []
    geoms: list[np.ndarray] = []
    normals: list[np.ndarray] = []
    for i in range(len(chosen)):
        mujoco.mj_resetData(model, data)
        compat.set_state(model, data, state[i], spec)
        data.ctrl[:] = control[i]
        mujoco.mj_step(model, data)
        compat.get_state(model, data, after[i], spec)
        constraints[i] = data.nefc
        for contact in data.contact[: data.ncon]:
            rows.append(i)
            geoms.append(np.array([contact.geom1, contact.geom2]))
            normals.append(np.array(contact.frame[:3]))
    return SingleSteps(state, control, after, Contacts.of(rows, geoms, normals), constraints)


def _spread(count: int, most: int) -> np.ndarray:
    """Return at most `most` of `count` indices, evenly spread from the first to the last."""
    return np.unique(np.linspace(0, count - 1, min(most, count)).astype(int))


def as_float32(values: np.ndarray) -> np.ndarray:
    """Return values as float32 can hold them, in float64."""
    return values.astype(np.float32).astype(np.float64)
