"""Each step makes an array of all rows so far, for their mean."""

import mujoco
import numpy as np
from common import COUNT, REACHER, Stopwatch

model = mujoco.MjModel.from_xml_string(REACHER)
data = mujoco.MjData(model)
rows = []
with Stopwatch():
    for _ in range(COUNT):
        mujoco.mj_step(model, data)
        rows.append(data.qvel.copy())
        mean = np.array(rows).mean(axis=0)
