"""Random shooting: each candidate begins from a copy in an MjData that stays."""

import mujoco
import numpy as np
from common import COUNT, REACHER, Stopwatch

model = mujoco.MjModel.from_xml_string(REACHER)
data = mujoco.MjData(model)
candidate = mujoco.MjData(model)
rng = np.random.default_rng(0)
plans = rng.uniform(-1, 1, (COUNT, 10, model.nu))
with Stopwatch():
    for plan in plans:
        mujoco.mj_copyData(candidate, model, data)
        for ctrl in plan:
            candidate.ctrl[:] = ctrl
            mujoco.mj_step(model, candidate)
