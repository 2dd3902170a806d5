"""Each episode compiles the model anew."""

import mujoco
from common import COUNT, REACHER, Stopwatch

with Stopwatch():
    for _ in range(max(4, COUNT // 10)):
        model = mujoco.MjModel.from_xml_string(REACHER)
        data = mujoco.MjData(model)
        for _ in range(100):
            mujoco.mj_step(model, data)
