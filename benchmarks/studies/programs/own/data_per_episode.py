"""Each episode creates an MjData."""

import mujoco
from common import COUNT, REACHER, Stopwatch

model = mujoco.MjModel.from_xml_string(REACHER)
with Stopwatch():
    for _ in range(COUNT):
        data = mujoco.MjData(model)
        for _ in range(10):
            mujoco.mj_step(model, data)
