"""Each episode resets one MjData."""

import mujoco
from common import COUNT, REACHER, Stopwatch

model = mujoco.MjModel.from_xml_string(REACHER)
data = mujoco.MjData(model)
with Stopwatch():
    for _ in range(COUNT):
        mujoco.mj_resetData(model, data)
        for _ in range(10):
            mujoco.mj_step(model, data)
