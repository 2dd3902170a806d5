"""Each step adds its row to a sum."""

import mujoco
import numpy as np
from common import COUNT, REACHER, Stopwatch

model = mujoco.MjModel.from_xml_string(REACHER)
data = mujoco.MjData(model)
total = np.zeros(model.nv)
with Stopwatch():
    for count in range(1, COUNT + 1):
        mujoco.mj_step(model, data)
        total += data.qvel
        mean = total / count
