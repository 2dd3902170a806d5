"""Each episode has a new MjData of one model."""

import mujoco
from common import COUNT, REACHER, Stopwatch

with Stopwatch():
    model = mujoco.MjModel.from_xml_string(REACHER)
    for _ in range(max(4, COUNT // 10)):
        data = mujoco.MjData(model)
        for _ in range(100):
            mujoco.mj_step(model, data)
