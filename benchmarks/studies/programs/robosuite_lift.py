"""robosuite's Lift with a Panda and random actions, without images, until it is ended."""

import numpy as np
import robosuite

env = robosuite.make(
    "Lift",
    robots="Panda",
    has_renderer=False,
    has_offscreen_renderer=False,
    use_camera_obs=False,
)
(low, high), rng = env.action_spec, np.random.default_rng(0)
env.reset()
while True:
    _, _, done, _ = env.step(rng.uniform(low, high))
    if done:
        env.reset()
