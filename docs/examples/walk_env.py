"""Search for a policy that walks: random changes of its weights, tried in Gymnasium's Humanoid-v5.

    python docs/examples/walk_env.py [--generations 10]

docs/guides/story.md makes it faster; walk_batch.py beside this file is the result.
"""

import argparse
import time

import gymnasium
import numpy as np

NCANDIDATE, NSTEP, NHIDDEN = 16, 100, 32
NQPOS, NOBSERVATION, NACTION = 24, 45, 17


class Policy:
    """A network with one hidden layer, from positions and velocities to controls."""

    def __init__(self, weights):
        split = NOBSERVATION * NHIDDEN
        self.first = weights[:split].reshape(NOBSERVATION, NHIDDEN)
        self.second = weights[split:].reshape(NHIDDEN, NACTION)

    def __call__(self, observation):
        """Return the controls for one observation."""
        return 0.4 * np.tanh(np.tanh(observation @ self.first) @ self.second)


def episode(env, policy, seed):
    """Return the score, of distance and time survived, and the number of steps."""
    observation, _ = env.reset(seed=seed)
    start = env.unwrapped.data.qpos[0]
    for step in range(NSTEP):
        observation, _, terminated, _, info = env.step(policy(observation[:NOBSERVATION]))
        score = info["x_position"] - start + 0.01 * step
        if terminated:
            break
    return score, step + 1


def main():
    """Search, and print the best score and the speed."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--generations", type=int, default=10)
    generations = parser.parse_args().generations
    env = gymnasium.make("Humanoid-v5")
    rng = np.random.default_rng(0)
    weights = np.zeros(NHIDDEN * (NOBSERVATION + NACTION))
    began, steps = time.perf_counter(), 0
    for generation in range(generations):
        changes = 0.1 * rng.standard_normal((NCANDIDATE, weights.size))
        scores = []
        for change in changes:
            score, nstep = episode(env, Policy(weights + change), seed=generation)
            scores.append(score)
            steps += nstep
        weights += changes[np.argmax(scores)]
    seconds = time.perf_counter() - began
    print(f"best score {max(scores):.4f}, {steps / seconds:,.0f} steps of env a second")


if __name__ == "__main__":
    main()
