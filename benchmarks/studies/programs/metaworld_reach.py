"""Meta-World's reach-v3 with random actions, until it is ended."""

import gymnasium
import metaworld  # noqa: F401 - registers its environments

env = gymnasium.make("Meta-World/MT1", env_name="reach-v3", seed=0)
env.action_space.seed(0)
env.reset(seed=0)
while True:
    _, _, terminated, truncated, _ = env.step(env.action_space.sample())
    if terminated or truncated:
        env.reset()
