"""Ray actors as a path of one's own: each actor steps its share of the simulations.

    cd docs/examples
    mjbench compare cartpole --paths ray_path:Ray,rollout --nstep 200 --nbatch 64

`--paths` takes MODULE:CLASS, a subclass of `mjbench.paths.SteppingPath`. `prepare` starts all that
a run needs; only `run` is timed, and its final states must be those of the plain loop, bit by bit.
"""

import os
import sys
from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
import ray

from mjbench import paths
from mjbench.simulation.workload import Workload

STATE = mujoco.mjtState.mjSTATE_INTEGRATION
# Actors need not find this module.
ray.cloudpickle.register_pickle_by_value(sys.modules[__name__])


class Actor:
    """A process of Ray's with its own MjModel and MjData."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model, self._data = model, mujoco.MjData(model)

    def step(self, initial_state: np.ndarray, control: np.ndarray, hold: int) -> np.ndarray:
        """Return the final states of simulations, each control held for `hold` steps."""
        model, data, final_state = self._model, self._data, np.empty_like(initial_state)
        for start, controls, end in zip(initial_state, control, final_state, strict=True):
            mujoco.mj_resetData(model, data)
            mujoco.mj_setState(model, data, start, STATE)
            for values in controls:
                data.ctrl[:] = values
                mujoco.mj_step(model, data, hold)
            mujoco.mj_getState(model, data, end, STATE)
        return final_state


def start(model: mujoco.MjModel, count: int) -> Sequence[Any]:
    """Return actors; the first call starts Ray on this machine, whatever RAY_ADDRESS is."""
    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
    if not ray.is_initialized():
        ray.init(address="local", include_dashboard=False, logging_level="ERROR")
    # an actor takes no processor from others: Ray would start no more of them than it has
    remote, shared = ray.remote(num_cpus=0)(Actor), ray.put(model)
    return [remote.remote(shared) for _ in range(count)]


def step(
    actors: Sequence[Any], initial_state: np.ndarray, control: np.ndarray, hold: int
) -> np.ndarray:
    """Have each actor step its share; return all final states."""
    shares = np.array_split(np.arange(len(initial_state)), len(actors))
    calls = [
        actor.step.remote(initial_state[rows], control[rows], hold)
        for actor, rows in zip(actors, shares, strict=True)
    ]
    return np.concatenate(ray.get(calls))


class Ray(paths.SteppingPath):
    """What `mjbench compare` measures."""

    name = "ray_path:Ray"
    summary = "Ray actors, each a Python loop over its share"
    closed_loop = False
    starts_slowly = True
    options = (paths.Option("processes", "Ray actors, a process each", (), int),)

    def prepare(
        self, workload: Workload, options: paths.Options, resources: paths.Resources
    ) -> paths.Prepared:
        """Start Ray and the actors; Ray ends with the resources."""
        count = options["processes"]
        actors = resources.get_or_create(("ray", count), lambda: start(workload.model, count))
        resources.at_close(ray.shutdown)
        final_state = resources.final_state()

        def run() -> None:
            final_state[:] = step(actors, workload.initial_state, workload.control, workload.hold)

        return paths.Prepared(
            run, lambda: final_state.fill(np.nan), lambda: paths.States(final_state)
        )

    def snippet(self, workload: Workload, options: paths.Options) -> str:
        """Return the code that a user pastes."""
        return (
            "from ray_path import start, step\n\n"
            f"actors = start(model, {options['processes']})\n"
            f"final_state = step(actors, initial_state, control, {workload.hold})\n"
        )
