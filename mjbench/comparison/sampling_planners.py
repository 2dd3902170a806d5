"""Sampling planners (predictive sampling, MPPI and CEM), and what they are to achieve.

A planner proposes candidates, sequences of piecewise constant controls around its nominal one. From
the costs of their rollouts it improves its nominal sequence. It draws from a seeded generator, so
the same costs give the same plan, to the last bit.
"""

import enum
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np

from mjbench.simulation.workload import start_data


class Algorithm(enum.StrEnum):
    """How a planner improves its nominal controls."""

    PREDICTIVE_SAMPLING = "predictive-sampling"
    """Take the cheapest candidate (Howell et al. 2022, arXiv:2212.00541)."""
    MPPI = "mppi"
    """Take the mean of all, weighted by exp(-cost / temperature) (Williams et al. 2017,
    arXiv:1707.02342, equation 31)."""
    CEM = "cem"
    """Take the mean of the elites, and their standard deviation as the next noise (Rubinstein 1999,
    doi:10.1023/A:1010091220143)."""


@dataclass(frozen=True)
class PlannerSettings:
    """What a planner does.

    Attributes:
      samples: candidates of a plan, the nominal controls among them.
      knots: controls of a candidate.
      noise: standard deviation of the candidates' noise, as a share of half the control range.
      temperature: of MPPI, as a share of the standard deviation of the candidates' costs.
      elites: share of the candidates that CEM keeps.
    """

    algorithm: Algorithm = Algorithm.MPPI
    samples: int = 64
    knots: int = 10
    noise: float = 0.5
    temperature: float = 0.1
    elites: float = 0.1
    seed: int = 0


class Planner:
    """A planner with its nominal controls, (knots, nu), which are the best so far."""

    def __init__(
        self, settings: PlannerSettings, start: np.ndarray, low: np.ndarray, high: np.ndarray
    ):
        """Begin at constant controls; `start` and the limits are (nu,)."""
        self._settings, self._low, self._high = settings, low, high
        self._rng = np.random.default_rng(settings.seed)
        self._initial_sd = settings.noise * 0.5 * (high - low)
        self._sd = np.tile(self._initial_sd, (settings.knots, 1))
        self.nominal = np.tile(np.clip(start, low, high), (settings.knots, 1))

    def candidates(self) -> np.ndarray:
        """Return (samples, knots, nu) controls; the first ones are the nominal ones."""
        settings = self._settings
        noise = self._rng.standard_normal((settings.samples, *self.nominal.shape))
        noise[0] = 0.0
        return np.clip(self.nominal + self._sd * noise, self._low, self._high)

    def improve(self, candidates: np.ndarray, costs: np.ndarray) -> None:
        """Improve the nominal controls by (samples,) costs; one that is not finite is the worst."""
        worst = np.max(costs[np.isfinite(costs)], initial=0.0)
        costs = np.where(np.isfinite(costs), costs, worst)
        match self._settings.algorithm:
            case Algorithm.PREDICTIVE_SAMPLING:
                self.nominal = candidates[np.argmin(costs)].copy()
            case Algorithm.MPPI:
                scale = self._settings.temperature * costs.std()
                weights = np.exp(-(costs - costs.min()) / max(float(scale), 1e-12))
                self.nominal = np.tensordot(weights / weights.sum(), candidates, axes=1)
            case Algorithm.CEM:
                count = max(2, round(self._settings.elites * len(costs)))
                elites = candidates[np.argsort(costs, kind="stable")[:count]]
                self.nominal = elites.mean(axis=0)
                # never less than a tenth of the noise it began with, so that it goes on searching
                self._sd = np.maximum(elites.std(axis=0), 0.1 * self._initial_sd)

    def advance(self) -> np.ndarray:
        """Return the (nu,) first control of the plan, and shift the plan by it."""
        control: np.ndarray = self.nominal[0].copy()
        self.nominal = np.vstack([self.nominal[1:], self.nominal[-1:]])
        self._sd = np.vstack([self._sd[1:], self._initial_sd[None]])
        return control


@dataclass(frozen=True)
class PlannerStates:
    """States by field: (…, nq) and (…, nv)."""

    qpos: np.ndarray
    qvel: np.ndarray

    @classmethod
    def of(cls, columns: Mapping[str, slice], physics: np.ndarray) -> "PlannerStates":
        """Return the fields of (…, nphysics) rows of mjSTATE_FULLPHYSICS."""
        return cls(physics[..., columns["qpos"]], physics[..., columns["qvel"]])


class PlanningTask(ABC):
    """A task on a model."""

    name: str

    def start(self, model: mujoco.MjModel) -> mujoco.MjData:
        return start_data(model)

    @abstractmethod
    def cost(self, states: PlannerStates, controls: np.ndarray) -> np.ndarray:
        """Return (n,) costs of (n, nstep, …) states and (n, knots, nu) controls."""

    @abstractmethod
    def is_achieved(self, states: PlannerStates) -> bool:
        """Return whether the last quarter of the loop, (nplan, …), is as it should be."""


class SwingUp(PlanningTask):
    """The pole of the cart-pole hangs down, and must come to stand."""

    name = "swing-up"

    def start(self, model: mujoco.MjModel) -> mujoco.MjData:
        data = start_data(model)
        data.qpos[:] = (0.0, np.pi)
        return data

    def cost(self, states: PlannerStates, controls: np.ndarray) -> np.ndarray:
        x, angle = states.qpos[..., 0], states.qpos[..., 1]
        running = 1 - np.cos(angle) + 0.1 * x**2 + 0.01 * (states.qvel**2).sum(axis=-1)
        return np.asarray(running.mean(axis=-1) + 0.01 * (controls**2).mean(axis=(1, 2)))

    def is_achieved(self, states: PlannerStates) -> bool:
        """See `PlanningTask.is_achieved`: within 15° of upright."""
        return bool((np.cos(states.qpos[..., 1]) > np.cos(np.radians(15))).all())


class HoldPose(PlanningTask):
    """The model must stay at its start: a robot holds its pose, a humanoid stays on its feet."""

    name = "hold pose"

    def __init__(self, model: mujoco.MjModel):
        data = start_data(model)
        self._qpos, self._ctrl = np.array(data.qpos), np.array(data.ctrl)

    def cost(self, states: PlannerStates, controls: np.ndarray) -> np.ndarray:
        offset = states.qpos - self._qpos
        running = (offset**2).sum(axis=-1) + 0.01 * (states.qvel**2).sum(axis=-1)
        effort = ((controls - self._ctrl) ** 2).mean(axis=(1, 2))
        return np.asarray(running.mean(axis=-1) + 0.01 * effort)

    def is_achieved(self, states: PlannerStates) -> bool:
        """See `PlanningTask.is_achieved`: no coordinate is off by more than 0.3 m or rad."""
        return bool((np.abs(states.qpos - self._qpos) < 0.3).all())


def task_of(name: str, model: mujoco.MjModel) -> PlanningTask:
    """Return the task of a shipped model by its name; of any other, to hold its pose."""
    return SwingUp() if name == "cartpole" else HoldPose(model)
