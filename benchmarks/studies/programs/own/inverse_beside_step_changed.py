"""As inverse_beside_step, with what the step computes anyway."""

import mujoco
from common import COUNT, REACHER, Stopwatch

model = mujoco.MjModel.from_xml_string(REACHER)
data = mujoco.MjData(model)
velocity = mujoco.mjtStage.mjSTAGE_VEL
with Stopwatch():
    for _ in range(15 * COUNT):
        mujoco.mj_step1(model, data)
        data.qacc[:2] = 1.0 - data.qpos[:2] - data.qvel[:2]
        mujoco.mj_inverseSkip(model, data, velocity, 1)
        data.ctrl[:] = data.qfrc_inverse[:2]
        mujoco.mj_step2(model, data)
