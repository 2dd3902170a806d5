"""Computed torques: mj_inverse for the wanted acceleration, and then a step."""

import mujoco
from common import COUNT, REACHER, Stopwatch

model = mujoco.MjModel.from_xml_string(REACHER)
data = mujoco.MjData(model)
with Stopwatch():
    for _ in range(15 * COUNT):
        data.qacc[:2] = 1.0 - data.qpos[:2] - data.qvel[:2]
        mujoco.mj_inverse(model, data)
        data.ctrl[:] = data.qfrc_inverse[:2]
        mujoco.mj_step(model, data)
