"""As growing_log, with all rows from before the loop."""

import mujoco
import numpy as np
from common import COUNT, REACHER, Stopwatch

model = mujoco.MjModel.from_xml_string(REACHER)
data = mujoco.MjData(model)
with Stopwatch():
    log = np.empty((15 * COUNT, model.nq))
    for step in range(15 * COUNT):
        mujoco.mj_step(model, data)
        log[step] = data.qpos
