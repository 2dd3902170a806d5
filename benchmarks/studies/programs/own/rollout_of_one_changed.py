"""As rollout_of_one, with mj_step."""

import mujoco
import numpy as np
from common import COUNT, REACHER, Stopwatch

model = mujoco.MjModel.from_xml_string(REACHER)
data = mujoco.MjData(model)
control = np.zeros(model.nu)
with Stopwatch():
    for _ in range(10 * COUNT):
        data.ctrl[:] = control
        mujoco.mj_step(model, data)
