"""Random shooting: each candidate begins from a deep copy of the simulation."""

import copy

import mujoco
import numpy as np
from common import COUNT, REACHER, Stopwatch

model = mujoco.MjModel.from_xml_string(REACHER)
data = mujoco.MjData(model)
rng = np.random.default_rng(0)
plans = rng.uniform(-1, 1, (COUNT, 10, model.nu))
with Stopwatch():
    for plan in plans:
        candidate = copy.deepcopy(data)
        for ctrl in plan:
            candidate.ctrl[:] = ctrl
            mujoco.mj_step(model, candidate)
