"""Sample start states along a *settling run*: not at the keyframe, but where the model comes to.

The run begins at keyframe 0 (the model's defaults if it has none), with random controls like those
of the workload. The model first settles, and then moves on for as long again; starts are spread
evenly over this second part.
"""

import enum
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import mujoco
import numpy as np

from mjbench.bounds import NonNegativeFloat, NonNegativeInt
from mjbench.errors import InputError, one_line, shown
from mjbench.simulation import compat
from mjbench.simulation.workload import (
    START_VELOCITY_SD,
    random_controls,
    reset_to_start,
    stepped,
    whole_holds,
)

# What an .npy file begins with.
_NPY = b"\x93NUMPY"
# Simulated seconds for which a model settles unless the user says otherwise. A keyframe is a pose
# that its author chose; it loses its first transients. Without one, models start at their defaults,
# often in the air: objects that fall and tumble have come to rest by then (docs/method/work.md).
KEYFRAME_SETTLE_S = 0.1
DEFAULT_SETTLE_S = 5.0
# Seconds of computing that the settling run may take, by what a step costs.
MAX_SETTLING_S = 2.0


class SettleLimit(enum.StrEnum):
    """Why a model settled for less time than was asked for."""

    COST = "cost"
    """Its steps are slow: the settling run is limited by its cost."""
    DIVERGED = "diverged"
    """The settling run diverged, or simulations that start from it do: starts are keyframe 0."""


@dataclass(frozen=True)
class StartPlan:
    """Where start states are to come from, and the controls that follow.

    Attributes:
      settle_s: simulated seconds before the first start; 0 for keyframe 0, None for the default.
    """

    settle_s: float | None = None
    file: Path | None = None
    controls_file: Path | None = None

    @property
    def files(self) -> list[Path]:
        return [file for file in (self.file, self.controls_file) if file is not None]


DEFAULT_STARTS, KEYFRAME_STARTS = StartPlan(), StartPlan(settle_s=0.0)


def start_plan(
    settle_s: float | None, states_file: Path | None, actions_file: Path | None = None
) -> StartPlan:
    if states_file is not None:
        if settle_s is not None:
            raise InputError("give --settle or --states, not both")
        states_file = _array_file("--states", states_file)
    if actions_file is not None:
        actions_file = _array_file("--actions", actions_file)
    return StartPlan(settle_s, states_file, actions_file)


def _array_file(option: str, file: Path) -> Path:
    label = f"{option} {shown(str(file))}"
    try:
        if not file.is_file():
            raise InputError(f"{label}: no such file")
        with file.open("rb") as stream:
            is_npy = stream.read(len(_NPY)) == _NPY
    except (OSError, ValueError) as error:  # ValueError: a name that no file can have
        raise InputError(f"{label}: cannot be read: {one_line(error)}") from error
    if not zipfile.is_zipfile(file) and not (is_npy and option == "--actions"):
        forms = ".npz or .npy file" if option == "--actions" else ".npz file"
        raise InputError(f"{label}: not an {forms}, as numpy.savez writes it")
    return file.absolute()


@dataclass(frozen=True)
class Later:
    """What the model does later in its own run than where it was measured.

    Attributes:
      time_s: simulated seconds of the run.
      contacts: per step, in the second half of the time since the last start.
    """

    time_s: NonNegativeFloat
    contacts: NonNegativeFloat


@dataclass(frozen=True)
class Window:
    """What was stepped from the start states.

    Attributes:
      nstart: simulations, each from its own start state.
      nstep: steps of each simulation that count.
      contacts: per step.
      solver_limited: share of the steps whose solver stopped at its limit of iterations.
      asleep: mean share of the model's trees that slept; None where sleeping is not enabled.
      asleep_in_run: the same along the model's own run; None where starts are not of such a run.
      flat_hfields: height fields whose cells are all zero.
      later: None where starts are not of the model's own run, or its steps are too slow.
      warnings: number of simulations that raised each warning, of those that did not diverge.
    """

    nstart: NonNegativeInt
    nstep: NonNegativeInt
    contacts: NonNegativeFloat
    solver_limited: NonNegativeFloat = 0.0
    asleep: NonNegativeFloat | None = None
    asleep_in_run: NonNegativeFloat | None = None
    flat_hfields: NonNegativeInt = 0
    later: Later | None = None
    warnings: Mapping[str, NonNegativeInt] = field(default_factory=dict)


@dataclass(frozen=True)
class Starts:
    """Where start states came from, and what was stepped from them.

    Attributes:
      settle_s: simulated seconds before the first start; 0 for keyframe 0, or a file.
      asked_s: seconds that were asked for, or the model's default.
      limit: why `settle_s` is less than `asked_s`; None where it is not.
      file: name of the user's file of start states.
      controls_file: name of the file of controls; None for random ones.
      is_other_model: whether the file's states were captured from another model; False where the
        file does not say.
      held_inputs: MjData fields that the captured program set between steps; simulations hold them.
    """

    settle_s: NonNegativeFloat
    asked_s: NonNegativeFloat
    limit: SettleLimit | None = None
    file: str | None = None
    controls_file: str | None = None
    is_other_model: bool = False
    held_inputs: tuple[str, ...] = ()
    window: Window | None = field(default=None, compare=False)  # measured, not asked for


def settle_s(model: mujoco.MjModel, plan: StartPlan) -> float:
    if plan.settle_s is not None:
        return plan.settle_s
    return KEYFRAME_SETTLE_S if model.nkey else DEFAULT_SETTLE_S


def settling_nstep(model: mujoco.MjModel, plan: StartPlan) -> int:
    """Return the steps of the settling run that a plan asks for; 0 where it needs none."""
    wanted_s = settle_s(model, plan)
    if plan.file is not None or wanted_s == 0:
        return 0
    return 2 * settle_nstep(model, wanted_s)


def max_settling_nstep(step_s: float) -> int:
    return max(2, int(MAX_SETTLING_S / step_s))


def settle_nstep(model: mujoco.MjModel, settle_s: float, max_nstep: int | None = None) -> int:
    """Return the steps for which a model settles: half of its run of `max_nstep` at most."""
    nstep = max(1, round(settle_s / float(model.opt.timestep)))
    return nstep if max_nstep is None else min(nstep, max(1, max_nstep // 2))


def settled(
    model: mujoco.MjModel,
    nbatch: int,
    settle_nstep: int,
    hold: int = 1,
    seed: int = 0,
    spread: float = 1.0,
    perturbs: bool = True,
) -> tuple[np.ndarray, float | None] | None:
    """Return start states along a run of the model; None where the run diverges.

    Velocities of each may be perturbed by normal noise, so that simulations differ also where the
    model rests; positions are not, so that what touches stays in contact. The state is then stepped
    once, so its warm-start is that of the state before, as in any simulation.

    Args:
      settle_nstep: steps before the first; the run is twice as long.
      spread: scales noise and controls; at 0 the controls are the keyframe's.

    Returns:
      (nbatch, nstate) rows of mjSTATE_INTEGRATION, in the order of time; and the mean share of the
      model's trees that sleep there, None where sleeping is not enabled.
    """
    after = settle_nstep + (np.arange(nbatch) * settle_nstep) // nbatch
    run = _settling_run(model, after, hold, seed, spread)
    if run is None:
        return None
    states, asleep = run
    if perturbs:
        noise = np.random.default_rng([seed, 0]).standard_normal((nbatch, model.nv))
        qvel = compat.state_columns(model)["qvel"]
        states[:, qvel] += spread * START_VELOCITY_SD * noise
    return stepped(model, states), asleep


def _settling_run(
    model: mujoco.MjModel, after: np.ndarray, hold: int, seed: int, spread: float
) -> tuple[np.ndarray, float | None] | None:
    """Return states of one run after ascending numbers of steps, and the share of trees asleep.

    None stands for a run that diverges.
    """
    data = mujoco.MjData(model)
    nstep = whole_holds(int(after[-1]), hold) + hold
    rng = np.random.default_rng([seed, 2])
    control = random_controls(model, 1, nstep // hold, hold, rng, spread)[0]
    states = np.empty((len(after), compat.state_size(model)))
    is_asleep = []
    reset_to_start(model, data)
    done = 0
    for row, count in zip(states, after, strict=True):
        while done < count:
            data.ctrl[:] = control[done // hold]
            mujoco.mj_step(model, data)
            done += 1
        compat.get_state(model, data, row)
        is_asleep.append(compat.trees_asleep(model, data))
    diverged = compat.warning_counts(data)[compat.divergence_warnings()].any()
    if diverged or not np.isfinite(states).all():
        return None
    return states, float(np.mean(is_asleep)) if compat.has_sleep(model) else None
