"""A simulation that diverges, is reset by MuJoCo, and goes into the average."""

import mujoco
from common import COUNT, REACHER, Stopwatch

model = mujoco.MjModel.from_xml_string(REACHER)
data = mujoco.MjData(model)
total = 0.0
with Stopwatch():
    for i in range(10 * COUNT):
        data.ctrl[:] = 9e9 if i == 5 * COUNT else 0.0
        mujoco.mj_step(model, data)
        total += data.qpos[0]
