"""The search of walk_env.py by mujoco.batch: all candidates at once, on threads.

    python docs/examples/walk_batch.py [--generations 10]

It gets the same scores. mujoco.batch needs MuJoCo 3.17 or newer.
"""

import argparse
import time

import gymnasium
import mujoco
import numpy as np
from mujoco.batch import Batch
from walk_env import NACTION, NCANDIDATE, NHIDDEN, NOBSERVATION, NSTEP, Policy

FRAME_SKIP, LEAST_HEIGHT, MOST_HEIGHT = 5, 1.0, 2.0


def scores_of(batch, start, policies):
    """Return the score of each policy, and the number of steps of all together."""
    qpos, qvel, ctrl = (batch.bind(name) for name in ("qpos", "qvel", "ctrl"))
    batch.reset()
    qpos[:], qvel[:] = start.qpos, start.qvel
    batch.bind("qacc_warmstart")[:] = start.qacc_warmstart
    running = np.arange(NCANDIDATE)
    distance, last = np.zeros(NCANDIDATE), np.zeros(NCANDIDATE, dtype=int)
    for step in range(NSTEP):
        for i in running:
            ctrl[i] = policies[i](np.concatenate((qpos[i, 2:], qvel[i])))
        batch.step(running, nstep=FRAME_SKIP)
        distance[running] = qpos[running, 0] - start.qpos[0]
        last[running] = step
        height = qpos[running, 2]
        running = running[(height > LEAST_HEIGHT) & (height < MOST_HEIGHT)]
        if not running.size:
            break
    return distance + 0.01 * last, int((last + 1).sum())


def main():
    """Search, and print the best score and the speed."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--generations", type=int, default=10)
    generations = parser.parse_args().generations
    env = gymnasium.make("Humanoid-v5")
    batch = Batch(env.unwrapped.model, NCANDIDATE)
    mujoco.mj_resetCallbacks()  # turns off the timer of MuJoCo's Python package
    rng = np.random.default_rng(0)
    weights = np.zeros(NHIDDEN * (NOBSERVATION + NACTION))
    began, steps = time.perf_counter(), 0
    for generation in range(generations):
        changes = 0.1 * rng.standard_normal((NCANDIDATE, weights.size))
        env.reset(seed=generation)
        policies = [Policy(weights + change) for change in changes]
        scores, nstep = scores_of(batch, env.unwrapped.data, policies)
        steps += nstep
        weights += changes[np.argmax(scores)]
    seconds = time.perf_counter() - began
    print(f"best score {max(scores):.4f}, {steps / seconds:,.0f} steps of env a second")


if __name__ == "__main__":
    main()
