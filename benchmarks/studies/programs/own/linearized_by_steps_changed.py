"""As linearized_by_steps, with mjd_transitionFD."""

import mujoco
import numpy as np
from common import COUNT, REACHER, Stopwatch

model = mujoco.MjModel.from_xml_string(REACHER)
data = mujoco.MjData(model)
matrix = np.empty((2 * model.nv, 2 * model.nv))
with Stopwatch():
    for _ in range(COUNT // 4):
        mujoco.mj_step(model, data)
        mujoco.mjd_transitionFD(model, data, 1e-6, False, matrix, None, None, None)
