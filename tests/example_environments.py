"""Small environments with the interfaces of Gymnasium, dm_control and robosuite, without them.

Each function is a factory, as `mjbench env example_environments:make` takes it.
"""

import os
import signal
import sys
import threading
import time
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import mujoco
import numpy as np
from mujoco import mj_rnePostConstraint

XML = """
<mujoco>
  <option timestep="0.01"/>
  <worldbody>
    <geom type="plane" size="2 2 .1"/>
    <body name="target" mocap="true" pos="0 0 1"/>
    <body name="ball" pos="0 0 .3">
      <freejoint/>
      <geom name="ball" size=".1" mass="1"/>
    </body>
    <body name="arm" pos="1 0 1">
      <joint name="shoulder" axis="0 1 0"/>
      <geom type="capsule" size=".03" fromto="0 0 0 .3 0 0" mass=".5"/>
    </body>
  </worldbody>
  <actuator><motor joint="shoulder" gear="1" ctrlrange="-1 1"/></actuator>
</mujoco>
"""
FRAME_SKIP = 4


class Box:
    """The bounds of an action, as Gymnasium's space has them."""

    def __init__(self, size: int):
        self.low, self.high = np.full(size, -1.0), np.full(size, 1.0)
        self.shape, self.dtype = (size,), np.float32


def doubled(value: float) -> float:
    """A function of the module that the step calls."""
    return 2 * value


class Env:
    """Like Gymnasium's MujocoEnv: an episode ends after 15 steps."""

    episode_nstep = 15

    def __init__(self) -> None:
        self.model = mujoco.MjModel.from_xml_string(XML)
        self.data = mujoco.MjData(self.model)
        self.action_space = Box(self.model.nu)
        self.count = 0

    def reset(self, *, seed: int | None = None) -> tuple[np.ndarray, dict[str, float]]:
        rng = np.random.default_rng(seed)
        mujoco.mj_resetData(self.model, self.data)
        self.data.qvel[:] = 0.1 * rng.standard_normal(self.model.nv)
        mujoco.mj_forward(self.model, self.data)
        self.count = 0
        return self._get_obs(), {}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, float]]:
        self.do_simulation(action)
        self.count += 1
        observation = self._get_obs()
        reward = self.score()
        info = {"speed": doubled(self.data.qvel[6])}
        return observation, reward, False, self.count >= self.episode_nstep, info

    def do_simulation(self, action: np.ndarray) -> None:
        self.data.ctrl[:] = action
        mujoco.mj_step(self.model, self.data, nstep=FRAME_SKIP)
        mj_rnePostConstraint(self.model, self.data)

    def _get_obs(self) -> np.ndarray:
        return np.concatenate([self.data.qpos, self.data.qvel])

    def score(self) -> float:
        return float(-abs(self.data.qpos[7]))


class Wrapper:
    """An environment around another one."""

    def __init__(self, env: Any):
        self.env = env
        self.action_space = env.action_space

    def reset(self, *, seed: int | None = None) -> Any:
        return self.env.reset(seed=seed)

    def step(self, action: Any) -> Any:
        return self.env.step(action)


class Outer(Wrapper):
    """Another wrapper."""


def make() -> Env:
    return Env()


def wrapped() -> Outer:
    return Outer(Wrapper(Env()))


class Kind(IntEnum):
    FIRST, MID, LAST = range(3)


@dataclass
class TimeStep:
    """What a step of dm_control returns."""

    step_type: Kind
    reward: float | None
    observation: dict[str, np.ndarray]

    def last(self) -> bool:
        return self.step_type == Kind.LAST


class Spec:
    """The bounds of an action, as dm_env has them."""

    shape, dtype, minimum, maximum = (1,), np.float64, -1.0, 1.0


class Physics:
    """Like dm_control's: positions and velocities are up to date after a step."""

    def __init__(self) -> None:
        self.model = mujoco.MjModel.from_xml_string(XML)
        self.data = mujoco.MjData(self.model)

    def step(self, nstep: int) -> None:
        mujoco.mj_step2(self.model, self.data)
        mujoco.mj_step(self.model, self.data, nstep - 1)
        mujoco.mj_step1(self.model, self.data)


class Task:
    """What is asked of the physics."""

    def __init__(self) -> None:
        self._random = np.random.RandomState(3)

    def start(self, physics: Physics) -> None:
        mujoco.mj_resetData(physics.model, physics.data)
        physics.data.qvel[:] = 0.1 * self._random.standard_normal(physics.model.nv)
        mujoco.mj_step1(physics.model, physics.data)

    def before_step(self, action: np.ndarray, physics: Physics) -> None:
        physics.data.ctrl[:] = action

    def get_reward(self, physics: Physics) -> float:
        return float(physics.data.qpos[7])

    def get_observation(self, physics: Physics) -> dict[str, np.ndarray]:
        return {"position": physics.data.qpos.copy()}


class DmEnvironment:
    """Like dm_control's Environment."""

    def __init__(self) -> None:
        self._physics, self._task, self._count = Physics(), Task(), 0

    @property
    def task(self) -> Task:
        return self._task

    def action_spec(self) -> Spec:
        return Spec()

    def reset(self) -> TimeStep:
        self._count = 0
        self._task.start(self._physics)
        return TimeStep(Kind.FIRST, None, self._task.get_observation(self._physics))

    def step(self, action: np.ndarray) -> TimeStep:
        self._task.before_step(action, self._physics)
        self._physics.step(FRAME_SKIP)
        reward = self._task.get_reward(self._physics)
        observation = self._task.get_observation(self._physics)
        self._count += 1
        return TimeStep(Kind.LAST if self._count >= 15 else Kind.MID, reward, observation)


def dm_control() -> DmEnvironment:
    return DmEnvironment()


class Sim:
    """Like robosuite's MjSim, made anew by each reset."""

    def __init__(self) -> None:
        self.model = mujoco.MjModel.from_xml_string(XML)
        self.data = mujoco.MjData(self.model)

    def step1(self) -> None:
        mujoco.mj_step1(self.model, self.data)

    def step2(self) -> None:
        mujoco.mj_step2(self.model, self.data)


class RobosuiteEnv:
    """Like robosuite's MujocoEnv: a controller sets another control for each step."""

    def __init__(self) -> None:
        self.rng = np.random.default_rng(1)
        self.sim = Sim()
        self.count = 0

    @property
    def action_spec(self) -> tuple[np.ndarray, np.ndarray]:
        return -np.ones(1), np.ones(1)

    def reset(self) -> dict[str, np.ndarray]:
        self.sim = Sim()
        self.sim.data.qvel[:] = 0.1 * self.rng.standard_normal(self.sim.model.nv)
        self.count = 0
        return {"qpos": self.sim.data.qpos.copy()}

    def step(self, action: np.ndarray) -> tuple[dict[str, np.ndarray], float, bool, dict[str, Any]]:
        for _ in range(FRAME_SKIP):
            self.sim.step1()
            self._pre_action(action)
            self.sim.step2()
        reward, done, info = self._post_action()
        return {"qpos": self.sim.data.qpos.copy()}, reward, done, info

    def _pre_action(self, action: np.ndarray) -> None:
        self.sim.data.ctrl[:] = action - self.sim.data.qpos[7]

    def _post_action(self) -> tuple[float, bool, dict[str, Any]]:
        self.count += 1
        return self.reward(), self.count >= 15, {}

    def reward(self) -> float:
        return float(self.sim.data.qpos[7])


def robosuite() -> RobosuiteEnv:
    return RobosuiteEnv()


class NewGravity(Env):
    """Changes its model between steps."""

    def do_simulation(self, action: np.ndarray) -> None:
        self.model.opt.gravity[2] = -9.0 - 0.01 * self.count
        super().do_simulation(action)


class NewMass(Env):
    """Changes its model in each reset."""

    def reset(self, *, seed: int | None = None) -> Any:
        self.model.body_mass[2] = 1 + np.random.default_rng(seed).random()
        return super().reset(seed=seed)


class WritesBetween(Env):
    """Writes a velocity between two steps of the engine."""

    def do_simulation(self, action: np.ndarray) -> None:
        self.data.ctrl[:] = action
        for _ in range(FRAME_SKIP):
            mujoco.mj_step(self.model, self.data)
            self.data.qvel[6] *= 0.9


class Mocap(Env):
    """Moves a mocap body before each of its steps."""

    def do_simulation(self, action: np.ndarray) -> None:
        self.data.mocap_pos[0, 0] += 0.01 * float(action[0])
        super().do_simulation(action)


class Varying(Env):
    """Takes a varying number of steps of the engine."""

    def do_simulation(self, action: np.ndarray) -> None:
        self.data.ctrl[:] = action
        mujoco.mj_step(self.model, self.data, nstep=1 + self.count % 3)


class Unseeded(Env):
    """Starts somewhere else in each reset, whatever its seed."""

    starts = np.random.default_rng(0)

    def reset(self, *, seed: int | None = None) -> Any:
        super().reset()
        self.data.qvel[6] = Unseeded.starts.random()
        return self._get_obs(), {}


class Timed(Env):
    """Puts a clock into its info, as wrappers that record statistics do."""

    def step(self, action: np.ndarray) -> Any:
        *returned, info = super().step(action)
        return *returned, {**info, "t": time.perf_counter_ns()}


class Remembering(Wrapper):
    """Divides observations by how many there were, as a wrapper that keeps statistics may do."""

    count = 0

    def step(self, action: np.ndarray) -> Any:
        observation, *rest = super().step(action)
        self.count += 1
        return observation / self.count, *rest


def remembering() -> Remembering:
    return Remembering(Env())


class Threaded(Env):
    """Steps the engine in a thread of its own."""

    def do_simulation(self, action: np.ndarray) -> None:
        self.data.ctrl[:] = action
        thread = threading.Thread(target=mujoco.mj_step, args=(self.model, self.data))
        thread.start()
        thread.join()


class StaleStart(Env):
    """Moves the arm after `mj_step1`, so that `mj_step2` goes on with what was computed before."""

    def do_simulation(self, action: np.ndarray) -> None:
        self.data.ctrl[:] = action
        mujoco.mj_step1(self.model, self.data)
        self.data.qpos[7] += 0.5
        mujoco.mj_step2(self.model, self.data)


class Forwards(Env):
    """Uses the engine, but never steps it."""

    def do_simulation(self, action: np.ndarray) -> None:
        self.data.qpos[7] += float(action[0])
        mujoco.mj_forward(self.model, self.data)


class NoPhysics(Env):
    """Never calls the engine."""

    def do_simulation(self, action: np.ndarray) -> None:
        self.data.qpos[7] += float(action[0])


class Raises(Env):
    """Fails in its third step."""

    def _get_obs(self) -> np.ndarray:
        if self.count == 3:
            raise KeyError("no such sensor")
        return super()._get_obs()


class Exits(Env):
    """Ends the process in its step."""

    def score(self) -> float:
        sys.exit(4)


class ReturnsNothing(Env):
    """Forgot to return what a step returns."""

    def step(self, action: np.ndarray) -> Any:
        super().step(action)


class Hangs(Env):
    """Never returns from its step."""

    def score(self) -> float:
        while True:
            time.sleep(60)


class Shapeless(Env):
    """Has an action space without bounds."""

    def __init__(self) -> None:
        super().__init__()
        self.action_space = object()  # type: ignore[assignment]


class Actionless(Env):
    """Does not say what an action is."""

    def __init__(self) -> None:
        super().__init__()
        del self.action_space


def number() -> int:
    return 3


def fails() -> Env:
    raise RuntimeError("no GPU here")


def needs_argument(name: str) -> Env:
    return Env()


not_callable = Env.episode_nstep


def crashes() -> Env:
    os.kill(os.getpid(), signal.SIGSEGV)
    return Env()
