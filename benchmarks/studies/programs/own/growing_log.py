"""A log is an array, which each step copies to add a row."""

import mujoco
import numpy as np
from common import COUNT, REACHER, Stopwatch

model = mujoco.MjModel.from_xml_string(REACHER)
data = mujoco.MjData(model)
log = np.empty((0, model.nq))
with Stopwatch():
    for _ in range(6 * COUNT):
        mujoco.mj_step(model, data)
        log = np.vstack([log, data.qpos])
