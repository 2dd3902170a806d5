"""Runs of a model from given starts under given controls, as states at fixed times.

Models with different timesteps get each control for the same simulated time, so their states are
comparable at the end of every control.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields, replace
from typing import NamedTuple

import mujoco
import numpy as np

from mjbench.errors import InputError
from mjbench.host import machine
from mjbench.simulation import compat

# A timestep divides the time of a control if their quotient is this near to a whole number.
_WHOLE = 1e-6
# Points of a run at which whole states are recorded, after equal shares of it.
NPOINT = 4
# A sensor's data have changed if they differ by more than this share of their largest magnitude.
SENSOR_SHARE = 0.01


@dataclass(frozen=True, eq=False)
class Trials:
    """The starts and controls from which every setting is tried.

    Attributes:
      initial_state: (nrun, nstate) rows of mjSTATE_INTEGRATION.
      control: (nrun, ncontrol, nu); each is held for `control_s` of simulated time.
    """

    initial_state: np.ndarray
    control: np.ndarray
    control_s: float

    @property
    def nrun(self) -> int:
        return int(self.control.shape[0])

    @property
    def ncontrol(self) -> int:
        return int(self.control.shape[1])

    def only(self, runs: np.ndarray) -> "Trials":
        return replace(self, initial_state=self.initial_state[runs], control=self.control[runs])

    def first(self, ncontrol: int) -> "Trials":
        return replace(self, control=self.control[:, :ncontrol])


@dataclass(frozen=True, eq=False)
class Trajectories:
    """The states of a model at the end of each control.

    Attributes:
      qpos: (nrun, ncontrol, nq).
      qvel: (nrun, ncontrol, nv).
      points: (nrun, NPOINT, nstate) whole states after equal shares of the run.
      sensordata: (nrun, NPOINT, nsensordata) of these whole states.
      diverged: (nrun,) bool: which raised a warning of a bad state, or are not finite.
    """

    qpos: np.ndarray
    qvel: np.ndarray
    points: np.ndarray
    sensordata: np.ndarray
    diverged: np.ndarray

    def only(self, runs: np.ndarray) -> "Trajectories":
        return Trajectories(*(getattr(self, each.name)[runs] for each in fields(self)))

    def first(self, ncontrol: int) -> "Trajectories":
        """Return runs until the end of their first controls; `points` are of the whole runs."""
        return replace(self, qpos=self.qpos[:, :ncontrol], qvel=self.qvel[:, :ncontrol])

    def is_identical(self, other: "Trajectories") -> bool:
        pairs = ((self.qpos, other.qpos), (self.qvel, other.qvel), (self.points, other.points))
        return all(np.array_equal(_bits(mine), _bits(others)) for mine, others in pairs)

    def has_sensors_of(self, other: "Trajectories") -> bool:
        return np.array_equal(_bits(self.sensordata), _bits(other.sensordata))


class SensorChange(NamedTuple):
    """How sensor data differ from those of other runs.

    Attributes:
      changed: sensors that differ by more than SENSOR_SHARE of their largest magnitude.
      share: by how much the others differ at most, as a share of theirs.
    """

    changed: int
    share: float


def sensor_change(model: mujoco.MjModel, runs: Trajectories, others: Trajectories) -> SensorChange:
    if not others.sensordata.shape[2]:
        return SensorChange(0, 0.0)
    largest = np.abs(others.sensordata).max(axis=(0, 1))
    apart = np.abs(runs.sensordata - others.sensordata).max(axis=(0, 1))
    changed, largest_share = 0, 0.0
    for at, dim in zip(model.sensor_adr, model.sensor_dim, strict=True):
        of_sensor = float(apart[at : at + dim].max(initial=0.0))
        magnitude = float(largest[at : at + dim].max(initial=0.0))
        if of_sensor > SENSOR_SHARE * magnitude:
            changed += 1
        elif magnitude:
            largest_share = max(largest_share, of_sensor / magnitude)
    return SensorChange(changed, largest_share)


def points(ncontrol: int) -> list[int]:
    """Return after how many controls whole states are recorded."""
    return [max(1, round(ncontrol * (k + 1) / NPOINT)) for k in range(NPOINT)]


def fitted(model: mujoco.MjModel, trials: Trials) -> Trials:
    """Return trials for a model that may have fewer bodies: a state has a force on each.

    Raises:
      InputError: the state differs in more than that, or there are such forces.
    """
    surplus = trials.initial_state.shape[1] - compat.state_size(model)
    if not surplus:
        return trials
    forces = compat.state_columns(model)["xfrc_applied"]
    end = forces.stop + surplus
    if surplus < 0 or trials.initial_state[:, forces.start : end].any():
        raise InputError("the setting changes the size of the model's state")
    states = np.delete(trials.initial_state, slice(forces.stop, end), axis=1)
    return replace(trials, initial_state=states)


def run(model: mujoco.MjModel, trials: Trials, nthread: int | None = None) -> Trajectories:
    trials = fitted(model, trials)
    nstep = steps_per_control(model, trials.control_s)
    nrun, ncontrol = trials.nrun, trials.ncontrol
    out = Trajectories(
        np.full((nrun, ncontrol, model.nq), np.nan),
        np.full((nrun, ncontrol, model.nv), np.nan),
        np.full((nrun, NPOINT, trials.initial_state.shape[1]), np.nan),
        np.full((nrun, NPOINT, model.nsensordata), np.nan),
        np.ones(nrun, dtype=bool),
    )
    nthread = min(nrun, nthread or machine.usable_cores())
    with ThreadPoolExecutor(nthread) as pool:
        shares = np.array_split(np.arange(nrun), nthread)
        list(pool.map(lambda rows: _run(model, trials, nstep, rows, out), shares))
    return out


def steps_per_control(model: mujoco.MjModel, control_s: float) -> int:
    steps = control_s / float(model.opt.timestep)
    if round(steps) < 1 or abs(steps - round(steps)) > _WHOLE * steps:
        raise InputError(
            f"its timestep of {model.opt.timestep:g} s does not divide the {control_s:g} s of a"
            " control"
        )
    return round(steps)


def _run(
    model: mujoco.MjModel, trials: Trials, nstep: int, rows: np.ndarray, out: Trajectories
) -> None:
    data, sensing = mujoco.MjData(model), mujoco.MjData(model)
    is_bad = compat.divergence_warnings()
    at = points(trials.ncontrol)
    for row in rows:
        compat.restart(model, data, trials.initial_state[row])
        for k, control in enumerate(trials.control[row]):
            data.ctrl[:] = control
            mujoco.mj_step(model, data, nstep)
            out.qpos[row, k], out.qvel[row, k] = data.qpos, data.qvel
            for point in [i for i, after in enumerate(at) if after == k + 1]:
                compat.get_state(model, data, out.points[row, point])
                if model.nsensordata:  # after a step, they are of the state before
                    compat.restart(model, sensing, out.points[row, point])
                    mujoco.mj_forward(model, sensing)
                    out.sensordata[row, point] = sensing.sensordata
            if compat.warning_counts(data)[is_bad].any():
                break
        else:
            out.diverged[row] = not np.isfinite(out.qpos[row]).all()


def _bits(values: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(values).view(np.uint64)
