"""Inverse kinematics, which does not step, with all of mj_forward."""

import mujoco
import numpy as np
from common import COUNT, REACHER, Stopwatch

model = mujoco.MjModel.from_xml_string(REACHER)
data = mujoco.MjData(model)
target, jacobian = np.array([0.2, 0.2, 0.0]), np.zeros((3, model.nv))
with Stopwatch():
    for _ in range(60 * COUNT):
        mujoco.mj_forward(model, data)
        mujoco.mj_jacSite(model, data, jacobian, None, 0)
        velocity = jacobian.T @ (target - data.site_xpos[0])
        mujoco.mj_integratePos(model, data.qpos, velocity, 0.1)
