"""The same work for every path: start states, controls and number of steps.

A `Workload` determines everything that is computed. Two paths that run the same workload must
reach the same final states; two releases that run it take the same steps.
"""

import dataclasses
import enum
import functools
import hashlib
from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np

from mjbench.errors import InputError
from mjbench.simulation import compat

# Spread of the random starts around the keyframe: positions in metres or radians (tangent
# space), velocities per second. Small enough that a settled heap stays settled.
START_POSITION_SD = 1e-3
START_VELOCITY_SD = 1e-2
# Controls: an Ornstein-Uhlenbeck process around the keyframe's control, with this correlation
# time, and this share of half the control range (of one unit where there is no range) as its
# standard deviation.
CONTROL_TIME_S = 0.1
CONTROL_SHARE = 0.25
CONTROL_UNLIMITED_SD = 0.1


class Product(enum.StrEnum):
    """What a run returns to its caller; each product includes the ones before it."""

    FINAL = "final"
    """The last state of each simulation."""
    TRAJECTORY = "trajectory"
    """The state after every step, too."""
    SENSORS = "sensors"
    """The sensor data of every step, too."""


@dataclass(frozen=True, eq=False)
class Workload:
    """nbatch simulations of one model, each stepped nstep = ncontrol * hold times.

    Attributes:
      initial_state: (nbatch, nstate) rows of mjSTATE_INTEGRATION, with the warm-start.
      control: (nbatch, ncontrol, nu) controls in the actuators' units.
      hold: steps for which each control is held (an RL user's frame_skip).
      lead_in: steps of each simulation that come first and do not count: a state does not hold what
        sleeps, and bodies fall asleep again in them.
    """

    model: mujoco.MjModel
    initial_state: np.ndarray
    control: np.ndarray
    hold: int
    seed: int
    returns: Product = Product.FINAL
    lead_in: int = 0

    @property
    def nbatch(self) -> int:
        return int(self.initial_state.shape[0])

    @property
    def ncontrol(self) -> int:
        return int(self.control.shape[1])

    @property
    def nstep(self) -> int:
        return self.ncontrol * self.hold

    @property
    def steps(self) -> int:
        """Number of calls to mj_step of the whole workload."""
        return self.nbatch * self.nstep

    @functools.cached_property
    def step_control(self) -> np.ndarray:
        """(nbatch, nstep, nu) controls, one for every step."""
        if self.hold == 1:
            return self.control
        return np.repeat(self.control, self.hold, axis=1)

    def reorder(self, order: np.ndarray) -> None:
        """Reorder the simulations, in place: row i becomes what row `order[i]` was."""
        for array in (self.initial_state, self.control):
            array[...] = array[order]
        self.update_step_control()

    def update_step_control(self) -> None:
        """Follow a change of `control` in place, where `step_control` is an array of its own."""
        if self.hold > 1 and "step_control" in vars(self):
            self.step_control[...] = np.repeat(self.control, self.hold, axis=1)

    def digest(self) -> str:
        """Return 16 hexadecimal digits that identify the start states, controls and hold."""
        content = hashlib.blake2b(digest_size=8)
        content.update(np.array([self.nbatch, self.ncontrol, self.hold], dtype=np.int64).tobytes())
        content.update(np.ascontiguousarray(self.initial_state).tobytes())
        content.update(np.ascontiguousarray(self.control).tobytes())
        return content.hexdigest()

    def only(self, keep: np.ndarray) -> "Workload":
        """Return the workload of the simulations where the boolean mask `keep` is true."""
        if keep.all():
            return self
        return dataclasses.replace(
            self,
            initial_state=np.ascontiguousarray(self.initial_state[keep]),
            control=np.ascontiguousarray(self.control[keep]),
        )

    def returning(self, returns: Product) -> "Workload":
        return dataclasses.replace(self.first(self.ncontrol), returns=returns)

    def first(self, ncontrol: int) -> "Workload":
        return dataclasses.replace(
            self, initial_state=self.initial_state.copy(), control=self.control[:, :ncontrol].copy()
        )


@dataclass(frozen=True, eq=False)
class StepOutputs:
    """What a run returns of every step.

    Attributes:
      state: (nbatch, nstep, nphysics) rows of mjSTATE_FULLPHYSICS after each step.
      sensordata: (nbatch, nstep, nsensordata), as each step leaves it.
    """

    state: np.ndarray | None
    sensordata: np.ndarray | None

    @classmethod
    def empty(cls, workload: Workload) -> "StepOutputs":
        if workload.returns == Product.FINAL:
            return cls(None, None)
        model, shape = workload.model, (workload.nbatch, workload.nstep)
        state = np.empty((*shape, compat.state_size(model, compat.FULLPHYSICS)))
        has_sensors = workload.returns == Product.SENSORS
        return cls(state, np.empty((*shape, model.nsensordata)) if has_sensors else None)

    @property
    def arrays(self) -> list[np.ndarray]:
        return [array for array in (self.state, self.sensordata) if array is not None]

    def rows(self, i: int) -> tuple[np.ndarray, np.ndarray | None]:
        """Return state and sensor data of one simulation; there must be states."""
        assert self.state is not None, "a run that records has arrays to record to"
        return self.state[i], None if self.sensordata is None else self.sensordata[i]

    def part(self, rows: slice) -> "StepOutputs":
        """Return the arrays of some simulations, which share their memory with these."""
        arrays = (self.state, self.sensordata)
        return StepOutputs(*(None if array is None else array[rows] for array in arrays))

    def clear(self) -> None:
        for array in self.arrays:
            array.fill(np.nan)

    def reorder(self, order: np.ndarray) -> None:
        """Reorder the simulations in place: row i becomes what row `order[i]` was."""
        for array in self.arrays:
            array[...] = array[order]


def make(
    model: mujoco.MjModel,
    nbatch: int,
    nstep: int,
    hold: int = 1,
    seed: int = 0,
    spread: float = 1.0,
) -> Workload:
    """Return a random but reproducible workload around keyframe 0.

    Starts are keyframe 0 (the model's defaults if it has none), perturbed in position and velocity
    and then stepped once. So the warm-start is that of the previous state, as in any simulation;
    the solution itself would be no test, since a cold start finds it too. `spread` scales the
    perturbations and the noise of the controls; at 0 every simulation is the keyframe.
    """
    check_sizes(nbatch, nstep, hold)
    states = _starts(model, nbatch, np.random.default_rng([seed, 0]), spread)
    return starting(model, states, nstep, hold, seed, spread)


def starting(
    model: mujoco.MjModel, states: np.ndarray, nstep: int, hold: int, seed: int, spread: float
) -> Workload:
    """Return a workload from (nbatch, nstate) states, with random controls."""
    rng = np.random.default_rng([seed, 1])
    control = random_controls(model, len(states), nstep // hold, hold, rng, spread)
    return Workload(model, states, control, hold, seed)


def draw_order(nbatch: int, rng: np.random.Generator) -> np.ndarray:
    """Return an (nbatch,) order of simulations, another than they have where there are several."""
    order = rng.permutation(nbatch)
    return np.roll(order, 1) if np.array_equal(order, np.arange(nbatch)) else order


def check_sizes(nbatch: int, nstep: int, hold: int) -> None:
    for name, value in (("nbatch", nbatch), ("nstep", nstep), ("hold", hold)):
        if value < 1:
            raise InputError(f"{name} must be at least 1, got {value}")
    if nstep % hold:
        raise InputError(
            f"nstep {nstep} is not a multiple of hold {hold};"
            f" {nstep - nstep % hold or hold} or {nstep + hold - nstep % hold} is"
        )


def fields(model: mujoco.MjModel, states: np.ndarray) -> dict[str, np.ndarray]:
    """Return (nbatch, nstate) states split by MjData field: (nbatch, size), in every release."""
    columns = compat.state_columns(model)
    return {field: np.array(states[:, place]) for field, place in columns.items()}


def states(model: mujoco.MjModel, fields: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return rows of this release's mjSTATE_INTEGRATION, the inverse of `fields`.

    Fields that this release does not have are ignored; missing ones get the model's defaults.
    """
    columns = compat.state_columns(model)
    default = np.empty(compat.state_size(model))
    compat.get_state(model, mujoco.MjData(model), default)
    rows = np.tile(default, (len(next(iter(fields.values()))), 1))
    for field, place in columns.items():
        if field in fields:
            size, width = place.stop - place.start, fields[field].shape[1]
            if width != size:
                raise InputError(f"the model's {field} has {size} numbers, the workload's {width}")
            rows[:, place] = fields[field]
    return rows


@dataclass(frozen=True, eq=False)
class PortableWorkload:
    """A workload in a form that every release of MuJoCo can restore.

    Attributes:
      fields: the start states by MjData field, each (nbatch, size).
      final_state: (nbatch, nstate) states to reach, as rows of mjSTATE_INTEGRATION in the release
        that runs them; None where nothing is compared.
      probe: states along some simulations (see `state_drift.probe`); None where none are compared.
    """

    fields: Mapping[str, np.ndarray]
    control: np.ndarray
    hold: int
    final_state: np.ndarray | None = None
    probe: Mapping[str, np.ndarray] | None = None
    lead_in: int = 0

    def only(self, rows: np.ndarray, final_state: np.ndarray) -> "PortableWorkload":
        fields = {name: values[rows] for name, values in self.fields.items()}
        return PortableWorkload(
            fields, self.control[rows], self.hold, final_state[rows], lead_in=self.lead_in
        )

    def digest(self) -> str:
        content = hashlib.blake2b(str(self.hold).encode(), digest_size=8)
        for name, values in (*sorted(self.fields.items()), ("control", self.control)):
            content.update(f" {name} {values.shape} {values.dtype}".encode())
            content.update(np.ascontiguousarray(values).tobytes())
        return content.hexdigest()


def whole_holds(nstep: int, hold: int) -> int:
    """Return `nstep` rounded down to a multiple of `hold`, as `make` needs it; at least `hold`."""
    return hold * max(1, nstep // hold)


def portable(workload: Workload) -> PortableWorkload:
    start = fields(workload.model, workload.initial_state)
    return PortableWorkload(start, workload.control, workload.hold, lead_in=workload.lead_in)


def restore(model: mujoco.MjModel, portable: PortableWorkload) -> Workload:
    """Return the workload that `portable` wrote; InputError for a model of another size."""
    ncontrol = portable.control.shape[2]
    if ncontrol != model.nu:
        raise InputError(f"the model has {model.nu} controls, the workload {ncontrol}")
    start = states(model, portable.fields)
    return Workload(model, start, portable.control, portable.hold, seed=0, lead_in=portable.lead_in)


def start_data(model: mujoco.MjModel) -> mujoco.MjData:
    """Return a new MjData at keyframe 0, or at the model's defaults if it has none."""
    data = mujoco.MjData(model)
    reset_to_start(model, data)
    return data


def reset_to_start(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    else:
        mujoco.mj_resetData(model, data)


def stepped(
    model: mujoco.MjModel, states: np.ndarray, control: np.ndarray | None = None
) -> np.ndarray:
    """Return (n, nstate) states one step later, by (n, nu) controls or those of the states."""
    data, after = mujoco.MjData(model), np.empty_like(states)
    for i, row in enumerate(states):
        compat.restart(model, data, row)
        if control is not None:
            data.ctrl[:] = control[i]
        mujoco.mj_step(model, data)
        compat.get_state(model, data, after[i])
    return after


def _starts(
    model: mujoco.MjModel, nbatch: int, rng: np.random.Generator, spread: float
) -> np.ndarray:
    states = np.empty((nbatch, compat.state_size(model)))
    data = mujoco.MjData(model)
    for row in states:
        reset_to_start(model, data)
        offset = spread * START_POSITION_SD * rng.standard_normal(model.nv)
        mujoco.mj_integratePos(model, data.qpos, offset, 1.0)
        data.qvel[:] += spread * START_VELOCITY_SD * rng.standard_normal(model.nv)
        mujoco.mj_step(model, data)  # sets the warm-start to the solution of the previous state
        compat.get_state(model, data, row)
    return states


def random_controls(
    model: mujoco.MjModel,
    nbatch: int,
    ncontrol: int,
    hold: int,
    rng: np.random.Generator,
    spread: float,
) -> np.ndarray:
    """Return (nbatch, ncontrol, nu) controls: an Ornstein-Uhlenbeck process around the start's."""
    if model.nu == 0:
        return np.zeros((nbatch, ncontrol, 0))
    centre = np.array(start_data(model).ctrl)
    limited = np.array(model.actuator_ctrllimited, dtype=bool)
    low = np.where(limited, model.actuator_ctrlrange[:, 0], -np.inf)
    high = np.where(limited, model.actuator_ctrlrange[:, 1], np.inf)
    scale = np.full(model.nu, CONTROL_UNLIMITED_SD)
    scale[limited] = CONTROL_SHARE * 0.5 * (high - low)[limited]
    scale *= spread
    correlation = np.exp(-hold * model.opt.timestep / CONTROL_TIME_S)
    noise = rng.standard_normal((nbatch, model.nu))
    control = np.empty((nbatch, ncontrol, model.nu))
    for k in range(ncontrol):
        np.clip(centre + scale * noise, low, high, out=control[:, k])
        innovation = rng.standard_normal((nbatch, model.nu))
        noise = correlation * noise + np.sqrt(1.0 - correlation**2) * innovation
    return control
