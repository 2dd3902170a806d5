"""Four processes of Gymnasium's Humanoid-v5 with random actions, until it is ended."""

import gymnasium

if __name__ == "__main__":
    envs = gymnasium.make_vec("Humanoid-v5", num_envs=4, vectorization_mode="async")
    envs.action_space.seed(0)
    envs.reset(seed=0)
    while True:
        envs.step(envs.action_space.sample())
