"""A simulation by the Runge-Kutta method with steps of half a millisecond."""

import mujoco
from common import COUNT, REACHER, Stopwatch

model = mujoco.MjModel.from_xml_string(REACHER)
model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
model.opt.timestep = 0.0005
data = mujoco.MjData(model)
with Stopwatch():
    for _ in range(20 * COUNT):
        mujoco.mj_step(model, data)
