"""Gymnasium's Humanoid-v5 with random actions, until it is ended."""

import gymnasium

env = gymnasium.make("Humanoid-v5")
env.action_space.seed(0)
env.reset(seed=0)
while True:
    _, _, terminated, truncated, _ = env.step(env.action_space.sample())
    if terminated or truncated:
        env.reset()
