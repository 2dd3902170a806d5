"""Feedback between the halves of a step, under an integrator that has none."""

import mujoco
from common import COUNT, REACHER, Stopwatch

model = mujoco.MjModel.from_xml_string(REACHER)
model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
data = mujoco.MjData(model)
with Stopwatch():
    for _ in range(10 * COUNT):
        mujoco.mj_step1(model, data)
        data.ctrl[0] = -data.qvel[0]
        mujoco.mj_step2(model, data)
