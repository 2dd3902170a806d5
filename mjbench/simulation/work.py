"""Was it the same work? The reference run, with what each step had to do.

`observe` steps a workload in the plainest way there is (one MjData, reset before every
simulation, one `mj_step` a step) and counts contacts, constraints and solver iterations. Its
final states are what every path is compared with. It is never timed.
"""

import dataclasses
import time
from dataclasses import asdict, dataclass
from typing import Any

import mujoco
import numpy as np

from mjbench.errors import InputError
from mjbench.simulation import compat
from mjbench.simulation.workload import Workload, make, start_data

# Spreads of starts and controls, tried until the model bears one.
SPREADS = (1.0, 0.1, 0.01, 0.0)


@dataclass(frozen=True)
class Work:
    """What one step did on average, over all steps of all simulations.

    Attributes:
      contacts: contacts (`data.ncon`) per step.
      constraints: scalar constraints (`data.nefc`) per step.
      solver_iterations: solver iterations per step, summed over constraint islands.
    """

    contacts: float
    constraints: float
    solver_iterations: float

    def as_dict(self) -> dict[str, float]:
        """Return the counters by name."""
        return asdict(self)


@dataclass(frozen=True)
class Peaks:
    """The most that any step of the reference run had; buffers of a fixed size are made for it.

    Attributes:
      contacts: of one simulation.
      constraints: scalar constraints of one simulation.
    """

    contacts: int
    constraints: int


@dataclass(frozen=True, eq=False)
class Observation:
    """The reference run of a workload.

    Attributes:
      final_state: (nbatch, nstate) rows of mjSTATE_INTEGRATION after the last step.
      warnings: (nbatch, nwarning) how often each mjtWarning was raised.
      work: what a step did, averaged over the simulations without warnings.
      peaks: the most that a step of any simulation did.
      start_contacts: contacts at the first simulation's start.
    """

    final_state: np.ndarray
    warnings: np.ndarray
    work: Work
    peaks: Peaks
    start_contacts: int

    @property
    def healthy(self) -> np.ndarray:
        """(nbatch,) whether a simulation raised no warning; a rising counter is divergence."""
        return np.logical_not(self.warnings.any(axis=1))

    def diagnosis(self) -> str:
        """Return the warnings raised, by name and count of simulations, such as `BADQACC 3`."""
        counts = (self.warnings > 0).sum(axis=0)
        names = compat.warning_names()
        return ", ".join(f"{names[i]} in {n}" for i, n in enumerate(counts) if n)


def observe(workload: Workload) -> Observation:
    """Run the workload as the reference, counting what every step does."""
    model, spec = workload.model, compat.state_spec("INTEGRATION")
    data = mujoco.MjData(model)
    final_state = np.empty_like(workload.initial_state)
    warnings = np.zeros((workload.nbatch, len(compat.warning_counts(data))), dtype=int)
    counts = np.zeros((workload.nbatch, 3))
    most = np.zeros(2, dtype=int)
    start_contacts = 0
    for i in range(workload.nbatch):
        mujoco.mj_resetData(model, data)
        compat.set_state(model, data, workload.initial_state[i], spec)
        if i == 0:
            mujoco.mj_forward(model, data)
            start_contacts = int(data.ncon)
            compat.set_state(model, data, workload.initial_state[i], spec)
        counts[i] = _step(model, data, workload.control[i], workload.hold, most)
        warnings[i] = compat.warning_counts(data)
        compat.get_state(model, data, final_state[i], spec)
    healthy = ~warnings.any(axis=1)
    mean = counts[healthy].sum(axis=0) / max(1, int(healthy.sum()) * workload.nstep)
    peaks = Peaks(*map(int, most))
    return Observation(final_state, warnings, Work(*map(float, mean)), peaks, start_contacts)


def healthy(workload: Workload) -> tuple[Workload, Observation]:
    """Observe a workload; return it, and what was seen, without its diverged simulations.

    The observation's warnings are those of all simulations.
    """
    observed = observe(workload)
    final_state = np.ascontiguousarray(observed.final_state[observed.healthy])
    kept = workload.only(observed.healthy)
    return kept, dataclasses.replace(observed, final_state=final_state)


def stable_workload(
    model: Any, nbatch: int, nstep: int, hold: int, seed: int
) -> tuple[Workload, Observation, float]:
    """Return the workload with the widest spread of starts that a model bears.

    A model is taken to bear a spread when a quarter of the simulations do not diverge.

    Returns:
      The workload without diverged simulations, its reference run, and the spread.

    Raises:
      InputError: every simulation diverges.
    """
    for spread in SPREADS:
        kept, observed = healthy(make(model, nbatch, nstep, hold, seed, spread))
        if 4 * kept.nbatch >= nbatch:
            break
    if kept.nbatch == 0:
        raise InputError(
            f"every simulation diverges ({observed.diagnosis()}); there is nothing to compare"
        )
    return kept, observed, spread


def step_s(model: Any) -> float:
    """Return about how long one step takes at the start state, in seconds."""
    data = start_data(model)
    mujoco.mj_step(model, data)
    best = float("inf")
    begin = time.perf_counter()
    for _ in range(50):
        start = time.perf_counter()
        mujoco.mj_step(model, data, 2)
        now = time.perf_counter()
        best = min(best, (now - start) / 2)
        if now - begin > 0.05:
            break
    return max(best, 1e-8)


def _step(
    model: Any, data: Any, control: np.ndarray, hold: int, most: np.ndarray
) -> tuple[int, int, int]:
    """Step one simulation through its controls; return the three counters, summed.

    `most`, contacts and constraints, is raised where a step had more.
    """
    contacts = constraints = iterations = 0
    for ctrl in control:
        data.ctrl[:] = ctrl
        for _ in range(hold):
            mujoco.mj_step(model, data)
            ncon, nefc = int(data.ncon), int(data.nefc)
            contacts += ncon
            constraints += nefc
            most[:] = max(most[0], ncon), max(most[1], nefc)
            iterations += compat.solver_iterations(data)
    return contacts, constraints, iterations


def one_step(model: Any, states: np.ndarray) -> dict[str, np.ndarray]:
    """Return qpos, qvel and act, each (nstate, size), one step after each of `states`.

    Args:
      model: the MjModel.
      states: (nstate, size) rows of mjSTATE_INTEGRATION; their ctrl is applied.
    """
    spec, data = compat.state_spec("INTEGRATION"), mujoco.MjData(model)
    after: dict[str, list[np.ndarray]] = {"qpos": [], "qvel": [], "act": []}
    for row in states:
        mujoco.mj_resetData(model, data)
        compat.set_state(model, data, row, spec)
        mujoco.mj_step(model, data)
        for field, values in after.items():
            values.append(np.array(getattr(data, field)))
    return {field: np.array(values) for field, values in after.items()}


@dataclass(frozen=True)
class ModelFacts:
    """The facts of a model that decide what a step costs, at its start state.

    Attributes:
      nq: size of qpos.
      nv: degrees of freedom.
      nu: actuators.
      na: activation states.
      contacts: at the start state.
      constraints: scalar constraints at the start state.
      timestep: in seconds.
      integrator: by name, such as `euler`.
      solver: by name, such as `newton`.
      cone: by name, such as `pyramidal`.
    """

    nq: int
    nv: int
    nu: int
    na: int
    contacts: int
    constraints: int
    timestep: float
    integrator: str
    solver: str
    cone: str


def describe(model: Any) -> ModelFacts:
    """Return the facts of a model."""
    data = start_data(model)
    mujoco.mj_forward(model, data)
    return ModelFacts(
        nq=int(model.nq),
        nv=int(model.nv),
        nu=int(model.nu),
        na=int(model.na),
        contacts=int(data.ncon),
        constraints=int(data.nefc),
        timestep=float(model.opt.timestep),
        integrator=compat.enum_name(mujoco.mjtIntegrator, model.opt.integrator, "mjINT_"),
        solver=compat.enum_name(mujoco.mjtSolver, model.opt.solver, "mjSOL_"),
        cone=compat.enum_name(mujoco.mjtCone, model.opt.cone, "mjCONE_"),
    )
