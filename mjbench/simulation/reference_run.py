"""The reference run: final states to compare with, and the work that each step did.

`observe` steps a workload in the plainest way there is (one MjData, reset before every simulation,
one `mj_step` call per step) and counts contacts, constraints and solver iterations. Every path is
compared with its final states. It is never timed.
"""

import dataclasses
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass

import mujoco
import numpy as np

from mjbench.bounds import AnyFloat, NonNegativeFloat, NonNegativeInt
from mjbench.simulation import compat, geom_pairs
from mjbench.simulation.engine_clock import has_clock
from mjbench.simulation.workload import StepOutputs, Workload, start_data

# How long to measure the time of a step: at most this many times, and about this long in seconds.
_COST_CALLS, _COST_S = 50, 0.05
# Columns of `_count_steps`.
_NCOUNTER = 6
# A step that takes longer, in seconds, is measured once: what warms up hardly counts.
_LONG_STEP_S = 1.0


@dataclass(frozen=True)
class Work:
    """The work of one step: what it did, averaged over all steps of all simulations, and on what.

    From `degrees_of_freedom` on, they are sizes of the model; None where they were not counted.

    Attributes:
      contacts: `data.ncon`.
      constraints: `data.nefc`.
      solver_iterations: those of the constraint island with the most: about as many as in a
        release that solves all islands together.
      degrees_of_freedom: `nv`.
      actuators: 0 where actuation is disabled.
      sensors: sensors that a step computes; one with an interval counts for its share of the steps.
      rays: of rangefinders, counted like sensors.
      geom_pairs: pairs of geoms that the collision filters let through, and explicit pairs; None
        also where there are too many to look at (see `geom_pairs.MAX_GEOMS`).
      plugins: instances of engine plugins.
      mesh_vertices: of meshes that collide.
      hfield_cells: of height fields that collide.
      flex_vertices: of deformable bodies.
    """

    contacts: NonNegativeFloat
    constraints: NonNegativeFloat
    solver_iterations: NonNegativeFloat
    degrees_of_freedom: NonNegativeFloat | None = None
    actuators: NonNegativeFloat | None = None
    sensors: NonNegativeFloat | None = None
    rays: NonNegativeFloat | None = None
    geom_pairs: NonNegativeFloat | None = None
    tendons: NonNegativeFloat | None = None
    plugins: NonNegativeFloat | None = None
    mesh_vertices: NonNegativeFloat | None = None
    hfield_cells: NonNegativeFloat | None = None
    flex_vertices: NonNegativeFloat | None = None

    def as_dict(self) -> dict[str, float]:
        return {name: value for name, value in asdict(self).items() if value is not None}


@dataclass(frozen=True)
class Peaks:
    """The most of any simulation in any step of the reference run: fixed buffers must hold them."""

    contacts: int
    constraints: int


@dataclass(frozen=True, eq=False)
class Observation:
    """The reference run of a workload; see `Window` for what is not here.

    Attributes:
      final_state: (nbatch, nstate) rows of mjSTATE_INTEGRATION.
      warnings: (nbatch, nwarning) how often each simulation raised each mjtWarning.
      healthy: (nbatch,) bool: simulations that raised no warning of a bad state and ended in a
        finite one; the others are called diverged.
      work: mean over the steps of the healthy simulations.
      summed_iterations: solver iterations of a step, summed over constraint islands.
    """

    final_state: np.ndarray
    warnings: np.ndarray
    healthy: np.ndarray
    work: Work
    peaks: Peaks
    start_contacts: int
    summed_iterations: float
    solver_limited: float = 0.0
    asleep: float | None = None

    def diagnosis(self) -> str:
        """Return why simulations diverged and how many, such as `BADQACC in 3`."""
        bad = self.warnings[:, compat.divergence_warnings()].any(axis=1)
        counts = _raised(self.warnings[bad], compat.divergence_warnings())
        not_finite = int((~self.healthy & ~bad).sum())
        if not_finite:
            counts["a final state that is not finite"] = not_finite
        return ", ".join(f"{name} in {count}" for name, count in counts.items())

    def other_warnings(self) -> dict[str, int]:
        """Return the warnings of healthy simulations: how many raised each, by its name."""
        return _raised(self.warnings[self.healthy], ~compat.divergence_warnings())


@dataclass(frozen=True)
class ModelFacts:
    """The facts about a model that determine what a step costs.

    Attributes:
      contacts: at the start state, as `constraints`.
      timestep: in s.
      integrator: such as `euler`.
      solver: such as `newton`.
      cone: such as `pyramidal`.
      can_fall: whether gravity acts on a free body.
      has_clock: whether a step reads the timer of MuJoCo's Python package.
    """

    nq: NonNegativeInt
    nv: NonNegativeInt
    nu: NonNegativeInt
    na: NonNegativeInt
    contacts: NonNegativeInt
    constraints: NonNegativeInt
    timestep: AnyFloat
    integrator: str
    solver: str
    cone: str
    can_fall: bool
    has_clock: bool


def observe(workload: Workload) -> Observation:
    model, data = workload.model, mujoco.MjData(workload.model)
    final_state = np.empty_like(workload.initial_state)
    warnings = np.zeros((workload.nbatch, len(compat.warning_counts(data))), dtype=int)
    sums, maxima = np.zeros((workload.nbatch, _NCOUNTER)), np.zeros((workload.nbatch, 2), dtype=int)
    for i in range(workload.nbatch):
        compat.restart(model, data, workload.initial_state[i])
        counters = _count_steps(model, data, workload.control[i], workload.hold)
        sums[i] = counters[workload.lead_in :].sum(axis=0)
        maxima[i] = counters[:, :2].max(axis=0)
        warnings[i] = compat.warning_counts(data)
        compat.get_state(model, data, final_state[i])
    bad = warnings[:, compat.divergence_warnings()].any(axis=1)
    healthy = ~bad & np.isfinite(final_state).all(axis=1)
    counted = int(healthy.sum()) * (workload.nstep - workload.lead_in)
    mean = sums[healthy].sum(axis=0) / max(1, counted)
    contacts, constraints = maxima.max(axis=0)
    *means, summed_iterations, solver_limited, asleep = map(float, mean)
    return Observation(
        final_state,
        warnings,
        healthy,
        _work(model, *means),
        Peaks(int(contacts), int(constraints)),
        _start_contacts(workload),
        summed_iterations,
        solver_limited,
        asleep if compat.has_sleep(model) else None,
    )


def observe_healthy(workload: Workload) -> tuple[Workload, Observation]:
    """Return a workload and its reference run without the simulations that diverge.

    The observation's `warnings` and `healthy` are still those of all.
    """
    observation = observe(workload)
    final_state = np.ascontiguousarray(observation.final_state[observation.healthy])
    healthy = workload.only(observation.healthy)
    return healthy, dataclasses.replace(observation, final_state=final_state)


def step_s(model: mujoco.MjModel, state: np.ndarray | None = None) -> float:
    """Return about how many seconds one step takes, from a state or from keyframe 0."""
    data = start_data(model)
    if state is not None:
        compat.set_state(model, data, state)
    begin = time.perf_counter()
    mujoco.mj_step(model, data)
    warm_up_s = time.perf_counter() - begin
    if warm_up_s > _LONG_STEP_S:
        return warm_up_s
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


def states_after(workload: Workload, nsteps: Sequence[int]) -> np.ndarray:
    """Return (npoint, nbatch, nstate) states of a workload after ascending numbers of steps."""
    model, data = workload.model, mujoco.MjData(workload.model)
    states = np.empty((len(nsteps), *workload.initial_state.shape))
    for i, start in enumerate(workload.initial_state):
        compat.restart(model, data, start)
        done = 0
        for point, nstep in enumerate(nsteps):
            for k in range(done, nstep):
                data.ctrl[:] = workload.control[i, k // workload.hold]
                mujoco.mj_step(model, data)
            done = nstep
            compat.get_state(model, data, states[point, i])
    return states


def step_outputs(workload: Workload) -> StepOutputs:
    outputs = StepOutputs.empty(workload)
    if outputs.state is None:
        return outputs
    model, data = workload.model, mujoco.MjData(workload.model)
    physics = compat.FULLPHYSICS
    for i, start in enumerate(workload.initial_state):
        states, sensors = outputs.rows(i)
        compat.restart(model, data, start)
        for k in range(workload.nstep):
            data.ctrl[:] = workload.control[i, k // workload.hold]
            mujoco.mj_step(model, data)
            compat.get_state(model, data, states[k], physics)
            if sensors is not None:
                sensors[k] = data.sensordata
    return outputs


def describe(model: mujoco.MjModel) -> ModelFacts:
    data = start_data(model)
    mujoco.mj_forward(model, data)
    return ModelFacts(
        **{name: int(getattr(model, name)) for name in ("nq", "nv", "nu", "na")},
        contacts=int(data.ncon),
        constraints=int(data.nefc),
        timestep=float(model.opt.timestep),
        integrator=compat.enum_name(mujoco.mjtIntegrator, model.opt.integrator, "mjINT_"),
        solver=compat.enum_name(mujoco.mjtSolver, model.opt.solver, "mjSOL_"),
        cone=compat.enum_name(mujoco.mjtCone, model.opt.cone, "mjCONE_"),
        can_fall=_can_fall(model),
        has_clock=has_clock(model),
    )


def _work(
    model: mujoco.MjModel, contacts: float, constraints: float, solver_iterations: float
) -> Work:
    senses, shares = compat.flag_enabled(model, "sensor") is not False, compat.sensor_shares(model)
    is_ray = np.asarray(model.sensor_type) == int(mujoco.mjtSensor.mjSENS_RANGEFINDER)
    pairs = geom_pairs.read(model)
    collide = geom_pairs.colliding_geoms(model)
    kinds, assets = np.asarray(model.geom_type)[collide], np.asarray(model.geom_dataid)[collide]
    meshes = np.unique(assets[(kinds == int(mujoco.mjtGeom.mjGEOM_MESH)) & (assets >= 0)])
    hfields = np.unique(assets[kinds == int(mujoco.mjtGeom.mjGEOM_HFIELD)])
    cells = np.asarray(model.hfield_nrow) * np.asarray(model.hfield_ncol)
    return Work(
        contacts,
        constraints,
        solver_iterations,
        degrees_of_freedom=float(model.nv),
        actuators=float(model.nu) * (compat.flag_enabled(model, "actuation") is not False),
        sensors=senses * float(shares.sum()),
        rays=senses * float((shares * np.asarray(model.sensor_dim))[is_ray].sum()),
        geom_pairs=None if pairs.is_too_large else float(len(pairs.geoms) + model.npair),
        tendons=float(model.ntendon),
        plugins=float(getattr(model, "nplugin", 0)),
        mesh_vertices=float(np.asarray(model.mesh_vertnum)[meshes].sum()),
        hfield_cells=float(cells[hfields].sum()),
        flex_vertices=float(getattr(model, "nflexvert", 0)),
    )


def flat_hfields(model: mujoco.MjModel) -> int:
    """Return how many height fields have no height anywhere, such as those a program fills."""
    return sum(
        not np.any(model.hfield_data[adr : adr + nrow * ncol])
        for adr, nrow, ncol in zip(
            model.hfield_adr, model.hfield_nrow, model.hfield_ncol, strict=True
        )
    )


def _can_fall(model: mujoco.MjModel) -> bool:
    is_free = np.asarray(model.jnt_type) == int(mujoco.mjtJoint.mjJNT_FREE)
    no_gravity = int(model.opt.disableflags) & int(mujoco.mjtDisableBit.mjDSBL_GRAVITY)
    return bool(is_free.any() and np.any(model.opt.gravity) and not no_gravity)


def _count_steps(
    model: mujoco.MjModel, data: mujoco.MjData, control: np.ndarray, hold: int
) -> np.ndarray:
    """Step one simulation through its controls; return (nstep, _NCOUNTER) counters.

    They are contacts, scalar constraints, solver iterations (those of the constraint island with
    the most, and those of all), whether an island reached the limit of iterations, and the share of
    trees that slept.
    """
    counters, limit = [], int(model.opt.iterations) or np.inf
    for ctrl in control:
        data.ctrl[:] = ctrl
        for _ in range(hold):
            mujoco.mj_step(model, data)
            iterations, is_asleep = compat.solver_iterations(data), compat.trees_asleep(model, data)
            most = iterations.max()
            asleep = is_asleep.mean() if is_asleep.size else 0.0
            counters.append((data.ncon, data.nefc, most, iterations.sum(), most >= limit, asleep))
    return np.array(counters)


def _raised(warnings: np.ndarray, which: np.ndarray) -> dict[str, int]:
    """Return how many simulations raised each of some warnings, if any did, by its name."""
    counts = (warnings > 0).sum(axis=0)
    names = compat.warning_names()
    return {names[i]: int(counts[i]) for i in np.flatnonzero(which) if counts[i]}


def _start_contacts(workload: Workload) -> int:
    data = mujoco.MjData(workload.model)
    compat.set_state(workload.model, data, workload.initial_state[0])
    mujoco.mj_forward(workload.model, data)
    return int(data.ncon)
