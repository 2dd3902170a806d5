"""A controller linearizes each state by one call."""

import mujoco
import numpy as np
from common import COUNT, REACHER, Stopwatch

model = mujoco.MjModel.from_xml_string(REACHER)
data = mujoco.MjData(model)
A = np.empty((2 * model.nv, 2 * model.nv))
B = np.empty((2 * model.nv, model.nu))
with Stopwatch():
    for _ in range(COUNT // 4):
        mujoco.mjd_transitionFD(model, data, 1e-6, False, A, B, None, None)
        mujoco.mj_step(model, data)
