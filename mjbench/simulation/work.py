"""The reference run: final states to compare with, and the work that each step did.

`observe` steps a workload in the plainest way there is (one MjData, reset before every simulation,
one `mj_step` call per step) and counts contacts, constraints and solver iterations. Every path is
compared with its final states. It is never timed.
"""

import dataclasses
import time
from dataclasses import asdict, dataclass

import mujoco
import numpy as np

from mjbench.errors import InputError
from mjbench.simulation import compat
from mjbench.simulation.workload import Workload, make, start_data

# Spreads of starts and controls, tried in turn until few simulations diverge.
SPREADS = (1.0, 0.1, 0.01, 0.0)
# The share of simulations that must not diverge.
_LEAST_HEALTHY = 0.25
# How long to measure the time of a step: at most this many times, and about this long in seconds.
_COST_CALLS, _COST_S = 50, 0.05


@dataclass(frozen=True)
class Work:
    """The work of one step, averaged over all steps of all simulations.

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
    """Maxima over all steps of the reference run; they determine the size of fixed buffers.

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
      warnings: (nbatch, nwarning) how often each simulation raised each mjtWarning.
      work: of a step, averaged over the simulations without warnings.
      peaks: maxima over all steps of all simulations.
      start_contacts: contacts at the first simulation's start.
    """

    final_state: np.ndarray
    warnings: np.ndarray
    work: Work
    peaks: Peaks
    start_contacts: int

    @property
    def healthy(self) -> np.ndarray:
        """(nbatch,) bool: the simulations without a warning; the others are called diverged."""
        return np.logical_not(self.warnings.any(axis=1))

    def diagnosis(self) -> str:
        """Return the warnings by name and number of simulations, such as `BADQACC in 3`."""
        counts = (self.warnings > 0).sum(axis=0)
        names = compat.warning_names()
        return ", ".join(f"{names[i]} in {n}" for i, n in enumerate(counts) if n)


@dataclass(frozen=True)
class ModelFacts:
    """The facts about a model that determine what a step costs.

    Attributes:
      nq: numbers in qpos.
      nv: degrees of freedom.
      nu: controls.
      na: activations.
      contacts: at the start state.
      constraints: scalar constraints at the start state.
      timestep: in s.
      integrator: its name, such as `euler`.
      solver: its name, such as `newton`.
      cone: the name of the friction cone, such as `pyramidal`.
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


def observe(workload: Workload) -> Observation:
    """Return the reference run of a workload."""
    model, spec = workload.model, compat.state_spec("INTEGRATION")
    data = mujoco.MjData(model)
    final_state = np.empty_like(workload.initial_state)
    warnings = np.zeros((workload.nbatch, len(compat.warning_counts(data))), dtype=int)
    sums, maxima = np.zeros((workload.nbatch, 3)), np.zeros((workload.nbatch, 3), dtype=int)
    for i in range(workload.nbatch):
        mujoco.mj_resetData(model, data)
        compat.set_state(model, data, workload.initial_state[i], spec)
        counters = _count_steps(model, data, workload.control[i], workload.hold)
        sums[i], maxima[i] = counters.sum(axis=0), counters.max(axis=0)
        warnings[i] = compat.warning_counts(data)
        compat.get_state(model, data, final_state[i], spec)
    healthy = ~warnings.any(axis=1)
    mean = sums[healthy].sum(axis=0) / max(1, int(healthy.sum()) * workload.nstep)
    contacts, constraints, _ = maxima.max(axis=0)
    return Observation(
        final_state,
        warnings,
        Work(*map(float, mean)),
        Peaks(int(contacts), int(constraints)),
        _start_contacts(workload),
    )


def observe_healthy(workload: Workload) -> tuple[Workload, Observation]:
    """Return a workload and its reference run, both without the simulations that diverge.

    The observation's warnings are still those of all simulations.
    """
    observation = observe(workload)
    final_state = np.ascontiguousarray(observation.final_state[observation.healthy])
    healthy = workload.only(observation.healthy)
    return healthy, dataclasses.replace(observation, final_state=final_state)


def stable_workload(
    model: mujoco.MjModel, nbatch: int, nstep: int, hold: int, seed: int
) -> tuple[Workload, Observation, float]:
    """Return the workload with the widest spread of starts at which few simulations diverge.

    A spread is accepted if at least a quarter of the simulations do not diverge. Arguments are
    those of `workload.make`.

    Returns:
      The workload without diverged simulations, its reference run, and the spread.

    Raises:
      InputError: every simulation diverges.
    """
    for spread in SPREADS:
        workload, observation = observe_healthy(make(model, nbatch, nstep, hold, seed, spread))
        if workload.nbatch >= _LEAST_HEALTHY * nbatch:
            break
    if workload.nbatch == 0:
        raise InputError(
            f"every simulation diverges ({observation.diagnosis()}); there is nothing to compare"
        )
    return workload, observation, spread


def step_s(model: mujoco.MjModel) -> float:
    """Return about how long one step takes at the start state, in seconds."""
    data = start_data(model)
    mujoco.mj_step(model, data)
    best = float("inf")
    begin = time.perf_counter()
    for _ in range(_COST_CALLS):
        start = time.perf_counter()
        mujoco.mj_step(model, data, 2)
        now = time.perf_counter()
        best = min(best, (now - start) / 2)
        if now - begin > _COST_S:
            break
    return max(best, 1e-8)


def one_step(model: mujoco.MjModel, states: np.ndarray) -> dict[str, np.ndarray]:
    """Return qpos, qvel and act, each (nstate, size), one step after each of `states`.

    Args:
      model: to step.
      states: (nstate, size) rows of mjSTATE_INTEGRATION, which include the controls.
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


def describe(model: mujoco.MjModel) -> ModelFacts:
    """Return the facts about a model that determine what a step costs."""
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


def _count_steps(
    model: mujoco.MjModel, data: mujoco.MjData, control: np.ndarray, hold: int
) -> np.ndarray:
    """Step one simulation through (ncontrol, nu) controls, each held for `hold` steps.

    Returns:
      (nstep, 3) contacts, scalar constraints and solver iterations of each step.
    """
    counters = []
    for ctrl in control:
        data.ctrl[:] = ctrl
        for _ in range(hold):
            mujoco.mj_step(model, data)
            counters.append((int(data.ncon), int(data.nefc), compat.solver_iterations(data)))
    return np.array(counters)


def _start_contacts(workload: Workload) -> int:
    """Return the contacts at the first simulation's start."""
    data = mujoco.MjData(workload.model)
    spec = compat.state_spec("INTEGRATION")
    compat.set_state(workload.model, data, workload.initial_state[0], spec)
    mujoco.mj_forward(workload.model, data)
    return int(data.ncon)
