"""An invented record of an environment, for tests of what is derived from it."""

from typing import Any

from example_records import FACTS

from mjbench.commands.env.layers import Layer
from mjbench.commands.env.result import (
    EnvironmentFacts,
    EnvironmentRecord,
    PathSamples,
    PhysicsCheck,
    VectorForm,
    VectorSamples,
)
from mjbench.commands.env.timer import LayerSamples, TimerCost
from mjbench.status import Status

ROUNDS = 8


def steady(ns: float) -> list[float]:
    """Return samples around a value, which is their median."""
    return [ns * (1 + 0.001 * (i - (ROUNDS - 1) / 2)) for i in range(ROUNDS)]


def facts(**fields: Any) -> EnvironmentFacts:
    """Return facts about an environment with episodes of 20 steps."""
    usual: dict[str, Any] = {
        "framework": "Gymnasium",
        "core": "RobotEnv",
        "wrappers": ("TimeLimit",),
        "versions": {"gymnasium": "1.0.0"},
        "seed": 0,
        "nstep": 100,
        "nepisode": 5,
        "episode_nstep": 20.0,
        "repeats": True,
        "frame_skip": 5,
        "calls": ("mj_step(nstep=5)",),
        "entered": (),
        "model": FACTS,
    }
    return EnvironmentFacts(**{**usual, **fields})


def record(**fields: Any) -> EnvironmentRecord:
    """Return a record: a step of 100 µs, 60 of them physics; a timed call costs 1 µs.

    Four calls are timed, so a layered step takes 104 µs.
    """
    usual: dict[str, Any] = {
        "environment": "Robot-v0",
        "facts": facts(),
        "check": PhysicsCheck(Status.OK, "", 100, 96, 6, True),
        "step_ns": steady(100_000.0),
        "compared_ns": steady(100_000.0),
        "reset_ns": steady(200_000.0),
        "layered_ns": steady(104_000.0),
        "timer_ns": [4_000.0] * ROUNDS,
        "timer_cost": TimerCost(200.0, 200.0),
        "layers": [
            # two timed calls inside it: outside cost of 0.5 µs each
            LayerSamples(Layer.WRAPPERS, "TimeLimit", 1.0, 0.0, 1.0, steady(2_500.0)),
            LayerSamples(Layer.REST, "lines of RobotEnv.step", 1.0, 1.0, 3.0, steady(10_000.0)),
            LayerSamples(Layer.PHYSICS, "mj_step", 1.0, 1.0, 0.0, steady(60_500.0)),
            LayerSamples(Layer.OBSERVATION, "_get_obs", 1.0, 1.0, 0.0, steady(30_500.0)),
            LayerSamples(Layer.REWARD, "_get_rew", 1.0, 1.0, 0.0, steady(500.0)),
        ],
        "paths": [
            PathSamples("python_loop", {}, True, Status.OK, "", steady(50_000.0)),
            PathSamples("rollout", {"threads": 2}, False, Status.OK, "", steady(20_000.0)),
            PathSamples("batch_step", {"threads": 2}, True, Status.OK, "", steady(50_000.0)),
            PathSamples("batch_rollout", {}, False, Status.UNAVAILABLE, "needs mujoco.batch"),
        ],
        "cores": [1.9] * ROUNDS,
        "vectors": [
            VectorSamples(VectorForm.SYNC, 2, Status.OK, "", steady(110_000.0), steady(110_000.0)),
            VectorSamples(VectorForm.ASYNC, 2, Status.OK, "", steady(80_000.0), steady(120_000.0)),
        ],
    }
    return EnvironmentRecord(**{**usual, **fields})
