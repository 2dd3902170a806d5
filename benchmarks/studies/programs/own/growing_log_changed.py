"""A log is a list, which becomes an array after the loop."""

import mujoco
import numpy as np
from common import COUNT, REACHER, Stopwatch

model = mujoco.MjModel.from_xml_string(REACHER)
data = mujoco.MjData(model)
rows = []
with Stopwatch():
    for _ in range(6 * COUNT):
        mujoco.mj_step(model, data)
        rows.append(data.qpos.copy())
    log = np.array(rows)
