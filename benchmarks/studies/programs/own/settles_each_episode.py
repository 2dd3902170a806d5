"""Each episode settles the boxes before it begins."""

import mujoco
import numpy as np
from common import COUNT, REACHER, Stopwatch

model = mujoco.MjModel.from_xml_string(REACHER)
data = mujoco.MjData(model)
rng = np.random.default_rng(0)
with Stopwatch():
    for _ in range(max(4, COUNT // 5)):
        mujoco.mj_resetData(model, data)
        for _ in range(100):
            mujoco.mj_step(model, data)
        for _ in range(50):
            data.ctrl[:] = rng.uniform(-1, 1, model.nu)
            mujoco.mj_step(model, data)
