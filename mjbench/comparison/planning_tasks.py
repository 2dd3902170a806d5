"""What planners are to achieve: a start, a cost of states and controls, and when it is achieved."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np

from mjbench.simulation.workload import start_data


@dataclass(frozen=True)
class States:
    """States by field.

    Attributes:
      qpos: (…, nq).
      qvel: (…, nv).
    """

    qpos: np.ndarray
    qvel: np.ndarray

    @classmethod
    def of(cls, columns: Mapping[str, slice], physics: np.ndarray) -> "States":
        """Return the fields of states.

        Args:
          columns: of each field in a row of mjSTATE_FULLPHYSICS (see `compat.state_columns`).
          physics: (…, nphysics) rows.
        """
        return cls(physics[..., columns["qpos"]], physics[..., columns["qvel"]])


class PlanningTask(ABC):
    """A task on a model.

    Attributes:
      name: such as `swing-up`.
    """

    name: str

    def start(self, model: mujoco.MjModel) -> mujoco.MjData:
        """Return an MjData at the start: keyframe 0, or the model's defaults."""
        return start_data(model)

    @abstractmethod
    def cost(self, states: States, controls: np.ndarray) -> np.ndarray:
        """Return (n,) costs.

        Args:
          states: of n simulations, (n, nstep, …).
          controls: (n, knots, nu).
        """

    @abstractmethod
    def is_achieved(self, states: States) -> bool:
        """Return whether the last quarter of the loop, (nplan, …), is as it should be."""


class SwingUp(PlanningTask):
    """The pole of the cart-pole hangs down, and must come to stand."""

    name = "swing-up"

    def start(self, model: mujoco.MjModel) -> mujoco.MjData:
        """See `PlanningTask.start`."""
        data = start_data(model)
        data.qpos[:] = (0.0, np.pi)
        return data

    def cost(self, states: States, controls: np.ndarray) -> np.ndarray:
        """See `PlanningTask.cost`."""
        x, angle = states.qpos[..., 0], states.qpos[..., 1]
        running = 1 - np.cos(angle) + 0.1 * x**2 + 0.01 * (states.qvel**2).sum(axis=-1)
        return np.asarray(running.mean(axis=-1) + 0.01 * (controls**2).mean(axis=(1, 2)))

    def is_achieved(self, states: States) -> bool:
        """See `PlanningTask.is_achieved`: within 15° of upright."""
        return bool((np.cos(states.qpos[..., 1]) > np.cos(np.radians(15))).all())


class HoldPose(PlanningTask):
    """The model must stay at its start: a robot holds its pose, a humanoid stays on its feet."""

    name = "hold pose"

    def __init__(self, model: mujoco.MjModel):
        """Hold the start of this model."""
        data = start_data(model)
        self._qpos, self._ctrl = np.array(data.qpos), np.array(data.ctrl)

    def cost(self, states: States, controls: np.ndarray) -> np.ndarray:
        """See `PlanningTask.cost`."""
        offset = states.qpos - self._qpos
        running = (offset**2).sum(axis=-1) + 0.01 * (states.qvel**2).sum(axis=-1)
        effort = ((controls - self._ctrl) ** 2).mean(axis=(1, 2))
        return np.asarray(running.mean(axis=-1) + 0.01 * effort)

    def is_achieved(self, states: States) -> bool:
        """See `PlanningTask.is_achieved`: no coordinate is off by more than 0.3 m or rad."""
        return bool((np.abs(states.qpos - self._qpos) < 0.3).all())


def task_of(name: str, model: mujoco.MjModel) -> PlanningTask:
    """Return the task of a shipped model by its name; of any other, to hold its pose."""
    return SwingUp() if name == "cartpole" else HoldPose(model)
