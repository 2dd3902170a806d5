"""What a model's present settings are measured by: starts, a converged reference, and a horizon.

`present_runs` is enough to tell settings that change nothing from those that change something;
`with_reference` says by how much they err, and costs about ten times as much.

The reference is the user's model at an eighth of its timestep, with the constraint solver run to
convergence. Integrator, friction cone and all else are the user's, so it is the motion that this
model means. Erez, Tassa and Todorov (ICRA 2015) compare engines against their own small timesteps
in the same way.

Errors are compared over a *horizon*: as long as the present settings are still near the reference,
and rounding has not grown into the errors. Beyond it, contact and chaos make any two runs differ.
"""

from dataclasses import dataclass, replace

import mujoco
import numpy as np

from mjbench.bounds import NonNegativeFloat, NonNegativeInt
from mjbench.commands.tune import accuracy, trajectories
from mjbench.commands.tune.accuracy import Distance, Motion
from mjbench.commands.tune.solver_convergence import MOST_LIMITED, converged
from mjbench.commands.tune.trajectories import Trajectories, Trials
from mjbench.errors import InputError
from mjbench.host import machine
from mjbench.simulation import compat, reference_run, starts, workload, workload_sampling
from mjbench.simulation.starts import StartPlan, Starts

# The reference's timestep is the model's, divided by this.
REFINEMENT = 8
# Steps for which each control is held, unless the user says otherwise: a timestep that is larger by
# 2, 4 or 8 divides it, too.
HOLD = 8
# Runs from which settings are tried: `accuracy.bound` leaves out the largest errors of so many.
# With fewer than the least number it has less confidence. Where steps are slow, there are fewer.
NRUN, SLOW_NRUN, LEAST_NRUN = 64, 32, 29
# Settling runs from which the starts are drawn, each with a seed of its own, at most and at least;
# and seconds of computing for them.
DRAWS, LEAST_DRAWS, DRAWS_S = 16, 2, 4.0
# What the seeds of settling runs are apart, so that those of different looks differ.
_SEEDS_APART = 10_007
# Simulated seconds of a run at most, and controls of a run at least.
LONGEST_S, LEAST_NCONTROL = 1.0, 4
# Seconds of computing for the reference, which limit the length of runs.
REFERENCE_S = 8.0
# The horizon ends where half of the runs with present settings are off by this share of the motion,
MOST_SHARE = 0.1
# or where rounding has grown to this share of that error, or of the motion if that is more.
ROUNDING_OF_ERROR, ROUNDING_OF_MOTION = 0.01, 1e-9
# Settings are equivalent to the present ones if their runs differ by at most this share of the
# motion, whatever the present solver's own error is. On eight shipped models, what a converged
# solver changes is below it, and another cone or timestep changes at least 20 times as much.
SAME_SHARE = 1e-5
# They are compared for as long as starts that differ in the last place stay this near: a run rounds
# in every step, which makes up to this many times as much.
ROUNDING_FACTOR = 100.0
# A unit in the last place of numbers around 1: what rounding changes.
_ULP = float(np.finfo(float).eps)


@dataclass(frozen=True)
class TrialPlan:
    """The starts and controls that are asked for.

    Attributes:
      ncontrol: controls of a run; None for as many as can be afforded.
      reference_s: seconds of computing for the reference, which limit the length of runs.
    """

    seed: int
    starts: StartPlan
    hold: int = HOLD
    ncontrol: int | None = None
    reference_s: float = REFERENCE_S


@dataclass(frozen=True)
class CurrentSettings:
    """What the present settings do, beside the reference; None is what was not measured.

    Attributes:
      horizon_s: simulated seconds of each over which errors are compared.
      horizon_ncontrol: controls of each within the horizon.
      run_s: simulated seconds of each.
      is_comparable: whether errors mean something over the horizon; if not, it is the shortest one.
      error: of the present settings, from the reference.
      rounding: distance of runs from starts that differ in the last place.
      solver: distance of runs with the same timestep and a converged solver.
      converged_error: of these, from the reference.
    """

    nrun: NonNegativeInt
    horizon_s: NonNegativeFloat
    horizon_ncontrol: NonNegativeInt
    ncontrol: NonNegativeInt
    run_s: NonNegativeFloat
    is_comparable: bool
    starts: Starts
    error: Distance | None
    rounding: Distance
    solver: Distance | None
    converged_error: Distance | None = None

    @property
    def tolerated_error(self) -> float:
        """The error of the present settings that others may have as well, as a share of the motion.

        Where the solver does not converge, it is that of one that does: the rest is the solver's.
        """
        if self.error is None:
            return 0.0
        if self.is_converged or self.converged_error is None:
            return self.error.share
        return min(self.error.share, self.converged_error.share)

    @property
    def solver_limited(self) -> float:
        """Share of the steps in which the solver stopped at its limit of iterations."""
        return self.starts.window.solver_limited if self.starts.window else 0.0

    @property
    def is_converged(self) -> bool:
        """Whether the solver converges in nearly all steps, or as far as makes no difference."""
        is_near = self.solver is not None and self.solver.share <= SAME_SHARE
        return is_near or self.solver_limited <= MOST_LIMITED


@dataclass(frozen=True, eq=False)
class Baseline:
    """The present settings' runs, and what settings are compared with.

    Attributes:
      twin: the present settings' runs from starts that differ in the last place.
      same_ncontrol: controls of each run over which settings may be called equivalent.
      reference: of the converged model, within the horizon; None until `with_reference`.
    """

    trials: Trials
    motion: Motion
    present: Trajectories
    twin: Trajectories
    same_ncontrol: int
    reference: Trajectories | None
    facts: CurrentSettings

    def only(self, nrun: int) -> "Baseline":
        """Return some runs, from first to last; the facts are still those of all."""
        last = self.trials.nrun - 1
        return self._of(np.unique(np.linspace(0, last, min(nrun, last + 1)).astype(int)))

    def _of(self, runs: np.ndarray) -> "Baseline":
        return replace(
            self,
            trials=self.trials.only(runs),
            present=self.present.only(runs),
            twin=self.twin.only(runs),
            reference=self.reference.only(runs) if self.reference else None,
        )


def present_runs(model: mujoco.MjModel, plan: TrialPlan) -> Baseline:
    trials, came_from = draw(model, plan)
    present = trajectories.run(model, trials)
    twin = trajectories.run(model, perturbed(model, trials))
    healthy = _healthy("with the present settings", present, twin)
    trials, present, twin = trials.only(healthy), present.only(healthy), twin.only(healthy)
    scale = accuracy.motion(model, _initial_qpos(model, trials), present)
    ncontrol = trials.ncontrol
    facts = CurrentSettings(
        nrun=trials.nrun,
        horizon_s=ncontrol * trials.control_s,
        horizon_ncontrol=ncontrol,
        ncontrol=ncontrol,
        run_s=ncontrol * trials.control_s,
        is_comparable=False,
        starts=came_from,
        error=None,
        rounding=accuracy.distance(model, scale, twin, present),
        solver=None,
    )
    rounding = accuracy.bounds_over_time(model, scale, twin, present)
    is_same = np.logical_and.accumulate(rounding <= SAME_SHARE / ROUNDING_FACTOR)
    return Baseline(trials, scale, present, twin, int(is_same.sum()), None, facts)


def with_reference(
    model: mujoco.MjModel, runs: Baseline, horizon_ncontrol: int | None = None
) -> Baseline:
    reference = trajectories.run(converged(model, REFINEMENT), runs.trials)
    solver = trajectories.run(converged(model), runs.trials)
    healthy = _healthy("as the reference", reference, solver)
    runs, reference, solver = runs._of(healthy), reference.only(healthy), solver.only(healthy)
    trials, present, twin = runs.trials, runs.present, runs.twin
    initial_qpos = _initial_qpos(model, trials)
    scale = accuracy.motion(model, initial_qpos, reference)
    usable = horizon(
        accuracy.shares_over_time(model, scale, present, reference),
        accuracy.shares_over_time(model, scale, twin, present),
    )
    ncontrol = min(horizon_ncontrol or max(usable, LEAST_NCONTROL), trials.ncontrol)
    within = reference.first(ncontrol)
    scale = accuracy.motion(model, initial_qpos, within)

    def apart(runs: Trajectories, others: Trajectories) -> Distance:
        return accuracy.distance(model, scale, runs.first(ncontrol), others.first(ncontrol))

    facts = replace(
        runs.facts,
        nrun=trials.nrun,
        horizon_s=ncontrol * trials.control_s,
        horizon_ncontrol=ncontrol,
        is_comparable=horizon_ncontrol is not None or usable >= ncontrol,
        error=apart(present, reference),
        rounding=apart(twin, present),
        solver=apart(solver, present),
        converged_error=apart(solver, reference),
    )
    return replace(runs, motion=scale, reference=within, facts=facts)


def seconds(model: mujoco.MjModel, trials: Trials) -> float:
    """Return about how long `with_reference` takes at least: its steps, as long as present ones."""
    nstep = trials.ncontrol * trajectories.steps_per_control(model, trials.control_s)
    total = trials.nrun * nstep * (REFINEMENT + 1)  # with a converged solver at both timesteps
    step_s = reference_run.step_s(model, trials.initial_state[0])
    return total * step_s / min(trials.nrun, machine.usable_cores())


def _healthy(how: str, *runs: Trajectories) -> np.ndarray:
    """Return (nrun,) bool: which runs did not diverge; raises InputError where they are too few."""
    healthy = ~np.any([each.diverged for each in runs], axis=0)
    if healthy.sum() < LEAST_NRUN:
        raise InputError(
            f"{int((~healthy).sum())} of {len(healthy)} simulations diverge {how}: errors cannot be"
            " measured"
        )
    return np.asarray(healthy)


def _initial_qpos(model: mujoco.MjModel, trials: Trials) -> np.ndarray:
    return workload.fields(model, trials.initial_state)["qpos"]


def draw(model: mujoco.MjModel, plan: TrialPlan) -> tuple[Trials, Starts]:
    """Return starts and controls, in the model's usual regime, and where they came from.

    Starts of one settling run are alike, so they come from several; those of a file from one draw.
    """
    control_s = plan.hold * float(model.opt.timestep)
    step_s = workload_sampling.settled_step_s(model)
    affordable = plan.reference_s / (NRUN * REFINEMENT * plan.hold * step_s)
    nrun = int(np.clip(NRUN * affordable / LEAST_NCONTROL, SLOW_NRUN, NRUN))
    ncontrol = plan.ncontrol or int(max(LEAST_NCONTROL, min(LONGEST_S / control_s, affordable)))
    count = 1
    if plan.starts.file is None:
        settling_s = max(1, starts.settling_nstep(model, plan.starts)) * step_s
        scale = plan.reference_s / REFERENCE_S
        most = max(LEAST_DRAWS, round(scale * DRAWS))
        count = int(np.clip(scale * DRAWS_S / settling_s, LEAST_DRAWS, most))
    request = workload_sampling.SampleRequest(
        -(-nrun // count),
        ncontrol * plan.hold,
        plan.hold,
        plan.seed,
        plan.starts,
        starts.max_settling_nstep(step_s),
        may_shorten=True,
    )
    seeds = [plan.seed + number * _SEEDS_APART for number in range(count)]
    samples = [workload_sampling.draw(model, replace(request, seed=seed)) for seed in seeds]
    drawn = [sample.workload for sample in samples]
    shortest = min(each.ncontrol for each in drawn)
    trials = Trials(
        np.concatenate([each.initial_state for each in drawn])[:nrun],
        np.concatenate([each.control[:, :shortest] for each in drawn])[:nrun],
        control_s,
    )
    first = samples[0].starts
    assert first.window is not None, "it was drawn"
    nstep = shortest * plan.hold
    window = replace(first.window, nstart=len(trials.initial_state), nstep=nstep)
    return trials, replace(first, window=window)


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
      error: (nrun, ncontrol) of the present settings after each control, as shares of the motion.
      rounding: (nrun, ncontrol) distance of runs from starts that differ in the last place.
    """
    error_now, rounding_now = np.median(error, axis=0), np.median(rounding, axis=0)
    is_near = error_now <= MOST_SHARE
    is_exact = rounding_now <= np.maximum(ROUNDING_OF_ERROR * error_now, ROUNDING_OF_MOTION)
    usable = np.logical_and.accumulate(is_near & is_exact)
    return int(usable.sum())
