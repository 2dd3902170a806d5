"""dm_control's humanoid-walk with random actions, until it is ended."""

import numpy as np
from dm_control import suite

env = suite.load("humanoid", "walk", task_kwargs={"random": 0})
spec, rng = env.action_spec(), np.random.default_rng(0)
env.reset()
while True:
    if env.step(rng.uniform(spec.minimum, spec.maximum, spec.shape)).last():
        env.reset()
