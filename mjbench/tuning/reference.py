"""What a model's present settings are measured by: starts, a converged reference, and a horizon.

The reference is the user's model at an eighth of its timestep, with the constraint solver run to
convergence. Integrator, friction cone and all else are the user's, so it is the motion that this
model means. Erez, Tassa and Todorov (ICRA 2015) compare engines against their own small timesteps
in the same way.

Errors are compared over a *horizon*: as long as the present settings are still near the reference,
and rounding has not grown into the errors. Beyond it, contact and chaos make any two runs differ.
"""

import copy
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from mjbench.errors import InputError
from mjbench.simulation import compat, model_options, sampling, starts, workload
from mjbench.simulation.starts import StartPlan, Starts
from mjbench.tuning import distance, trajectories
from mjbench.tuning.distance import Distance, Motion
from mjbench.tuning.physics import Physics, physics
from mjbench.tuning.trajectories import Trajectories, Trials

# The reference's timestep is the model's, divided by this.
REFINEMENT = 8
# Steps for which each control is held, unless the user says otherwise: a timestep that is larger by
# 2, 4 or 8 divides it, too.
HOLD = 8
# Runs from which settings are tried: `distance.bound` leaves out the largest errors of so many.
# With fewer than the least number it has less confidence.
NRUN, LEAST_NRUN = 64, 29
# Settling runs from which the starts are drawn, each with a seed of its own, at most and at least;
# and seconds of computing for them.
DRAWS, LEAST_DRAWS, DRAWS_S = 16, 2, 4.0
# What the seeds of settling runs are apart, so that those of different looks differ.
_SEEDS_APART = 10_007
# Simulated seconds of a run at most, and controls of a run at least.
LONGEST_S, LEAST_NCONTROL = 1.0, 4
# Seconds of computing for the reference, which limit the length of runs.
REFERENCE_S = 8.0
# The converged solver: its tolerance, and its least numbers of iterations.
TOLERANCE, ITERATIONS, LS_ITERATIONS = 1e-15, 200, 100
# The horizon ends where half of the runs with present settings are off by this share of the motion,
MOST_SHARE = 0.1
# or where rounding has grown to this share of that error, or of the motion if that is more.
ROUNDING_OF_ERROR, ROUNDING_OF_MOTION = 0.01, 1e-9
# Settings are equivalent to the present ones if their distance is at most this many times that of a
# converged solver,
SOLVER_FACTOR = 2.0
# or this many times that of starts that differ in the last place, since a run rounds in every step,
ROUNDING_FACTOR = 100.0
# or this share of the motion.
LEAST_DISTANCE = 1e-12
# A unit in the last place of numbers around 1: what rounding changes.
_ULP = float(np.finfo(float).eps)


@dataclass(frozen=True)
class TrialPlan:
    """The starts and controls that are asked for.

    Attributes:
      ncontrol: controls of a run; None for as many as can be afforded.
      horizon_ncontrol: controls over which errors are compared; None to see how many can be.
    """

    seed: int
    starts: StartPlan
    hold: int = HOLD
    ncontrol: int | None = None
    horizon_ncontrol: int | None = None


@dataclass(frozen=True)
class Present:
    """What the present settings do, beside the reference.

    Attributes:
      horizon_s: simulated seconds of each over which errors are compared.
      horizon_ncontrol: controls of each within the horizon.
      run_s: simulated seconds of each.
      is_comparable: whether errors mean something over the horizon; if not, it is the shortest one.
      error: of the present settings, from the reference.
      rounding: distance of runs from starts that differ in the last place.
      solver: distance of runs with the same timestep and a converged solver.
      motion_m: how far the model moves, in m; None without such degrees of freedom.
      motion_rad: in rad.
    """

    nrun: int
    horizon_s: float
    horizon_ncontrol: int
    ncontrol: int
    run_s: float
    is_comparable: bool
    starts: Starts
    error: Distance
    rounding: Distance
    solver: Distance
    motion_m: float | None
    motion_rad: float | None
    physics: Physics
    reference_physics: Physics


@dataclass(frozen=True, eq=False)
class Baseline:
    """The present settings' runs, and what settings are compared with.

    Attributes:
      reference: of the converged model, within the horizon.
      unavoidable: (ncontrol,) how far runs with present settings are from themselves at the end of
        each control of the horizon, as shares of the motion: what their solver's tolerance and
        rounding make, as `equivalent_share` has it.
    """

    trials: Trials
    motion: Motion
    present: Trajectories
    reference: Trajectories
    unavoidable: np.ndarray
    facts: Present

    def only(self, nrun: int) -> "Baseline":
        """Return some runs, from first to last; the facts are still those of all."""
        last = self.trials.nrun - 1
        runs = np.unique(np.linspace(0, last, min(nrun, last + 1)).astype(int))
        return replace(
            self,
            trials=self.trials.only(runs),
            present=self.present.only(runs),
            reference=self.reference.only(runs),
        )


def baseline(model: mujoco.MjModel, plan: TrialPlan) -> Baseline:
    """Return the runs with present settings, the reference, and the horizon.

    Raises:
      InputError: the model diverges, or a file of states or controls does not fit it.
    """
    trials, came_from = draw(model, plan)
    present = trajectories.run(model, trials)
    reference = trajectories.run(converged(model, REFINEMENT), trials)
    twin = trajectories.run(model, perturbed(model, trials))
    solver = trajectories.run(converged(model), trials)
    healthy = ~(present.diverged | reference.diverged | twin.diverged | solver.diverged)
    if healthy.sum() < LEAST_NRUN:
        raise InputError(
            f"{int((~healthy).sum())} of {len(healthy)} runs diverge with the present settings or"
            " as the reference: errors cannot be measured"
        )
    trials = trials.only(healthy)
    present, reference, twin, solver = (
        runs.only(healthy) for runs in (present, reference, twin, solver)
    )
    initial_qpos = workload.fields(model, trials.initial_state)["qpos"]
    scale = distance.motion(model, initial_qpos, reference)
    usable = horizon(
        distance.shares_over_time(model, scale, present, reference),
        distance.shares_over_time(model, scale, twin, present),
    )
    ncontrol = min(plan.horizon_ncontrol or max(usable, LEAST_NCONTROL), trials.ncontrol)
    within = reference.first(ncontrol)
    scale = distance.motion(model, initial_qpos, within)

    def apart(runs: Trajectories, others: Trajectories) -> Distance:
        return distance.distance(model, scale, runs.first(ncontrol), others.first(ncontrol))

    facts = Present(
        nrun=trials.nrun,
        horizon_s=ncontrol * trials.control_s,
        horizon_ncontrol=ncontrol,
        ncontrol=trials.ncontrol,
        run_s=trials.ncontrol * trials.control_s,
        is_comparable=plan.horizon_ncontrol is not None or usable >= ncontrol,
        starts=came_from,
        error=apart(present, reference),
        rounding=apart(twin, present),
        solver=apart(solver, present),
        motion_m=scale.position.m,
        motion_rad=scale.position.rad,
        physics=physics(model, trials.initial_state, present.points),
        reference_physics=physics(model, trials.initial_state, reference.points),
    )
    unavoidable = equivalent_share(
        *(
            distance.bounds_over_time(model, scale, runs.first(ncontrol), present.first(ncontrol))
            for runs in (solver, twin)
        )
    )
    return Baseline(trials, scale, present, within, unavoidable, facts)


def draw(model: mujoco.MjModel, plan: TrialPlan) -> tuple[Trials, Starts]:
    """Return starts and controls, in the model's usual regime, and where they came from.

    Starts of one settling run are alike, so they come from several; those of a file from one draw.
    """
    control_s = plan.hold * float(model.opt.timestep)
    step_s = sampling.settled_step_s(model)
    affordable = REFERENCE_S / (NRUN * REFINEMENT * plan.hold * step_s)
    ncontrol = plan.ncontrol or int(max(LEAST_NCONTROL, min(LONGEST_S / control_s, affordable)))
    count = 1
    if plan.starts.file is None:
        settling_s = max(1, starts.settling_nstep(model, plan.starts)) * step_s
        count = int(np.clip(DRAWS_S / settling_s, LEAST_DRAWS, DRAWS))
    samples = [
        sampling.draw(
            model,
            sampling.SampleRequest(
                NRUN // count,
                ncontrol * plan.hold,
                plan.hold,
                plan.seed + number * _SEEDS_APART,
                plan.starts,
                starts.max_settling_nstep(step_s),
                may_shorten=True,
            ),
        )
        for number in range(count)
    ]
    drawn = [sample.workload for sample in samples]
    shortest = min(each.ncontrol for each in drawn)
    trials = Trials(
        np.concatenate([each.initial_state for each in drawn]),
        np.concatenate([each.control[:, :shortest] for each in drawn]),
        control_s,
    )
    first = samples[0].starts
    assert first.window is not None, "it was drawn"
    nstep = shortest * plan.hold
    window = replace(first.window, nstart=len(trials.initial_state), nstep=nstep)
    return trials, replace(first, window=window)


def equivalent_share(solver: np.ndarray, rounding: np.ndarray) -> np.ndarray:
    """Return how far equivalent settings may be from the present ones, control by control.

    Args:
      solver: (ncontrol,) distance of runs with a converged solver, as shares of the motion.
      rounding: (ncontrol,) distance of runs from starts that differ in the last place.
    """
    least = np.full_like(solver, LEAST_DISTANCE)
    most = np.maximum(SOLVER_FACTOR * solver, ROUNDING_FACTOR * rounding)
    return np.asarray(np.maximum(most, least))


def converged(model: mujoco.MjModel, refinement: int = 1) -> mujoco.MjModel:
    """Return a model whose constraint solver converges, with its timestep divided by a number."""
    tight = copy.copy(model)
    opt = tight.opt
    opt.timestep = float(opt.timestep) / refinement
    opt.solver = mujoco.mjtSolver.mjSOL_NEWTON
    opt.tolerance = TOLERANCE
    opt.iterations = max(int(opt.iterations), ITERATIONS)
    for name, least in (("ls_iterations", LS_ITERATIONS), ("ccd_iterations", ITERATIONS)):
        if hasattr(opt, name):
            setattr(opt, name, max(int(getattr(opt, name)), least))
    if opt.noslip_iterations:
        opt.noslip_iterations, opt.noslip_tolerance = ITERATIONS, TOLERANCE
    if compat.flag_enabled(tight, "sleep"):
        model_options.set_flag(opt, "sleep", "disable")
    return tight


def perturbed(model: mujoco.MjModel, trials: Trials) -> Trials:
    """Return trials whose start positions differ in the last place, as if by rounding."""
    rng = np.random.default_rng(0)
    states = trials.initial_state.copy()
    columns = compat.state_columns(model)["qpos"]
    for row in states:
        qpos = np.array(row[columns])
        mujoco.mj_integratePos(model, qpos, _ULP * rng.standard_normal(model.nv), 1.0)
        row[columns] = qpos
    return Trials(states, trials.control, trials.control_s)


def horizon(error: np.ndarray, rounding: np.ndarray) -> int:
    """Return for how many controls errors can be compared.

    Args:
      error: (nrun, ncontrol) of the present settings at the end of each control, as shares of the
        motion.
      rounding: (nrun, ncontrol) distance of runs from starts that differ in the last place.
    """
    error_now, rounding_now = np.median(error, axis=0), np.median(rounding, axis=0)
    is_near = error_now <= MOST_SHARE
    is_exact = rounding_now <= np.maximum(ROUNDING_OF_ERROR * error_now, ROUNDING_OF_MOTION)
    usable = np.logical_and.accumulate(is_near & is_exact)
    return int(usable.sum())
