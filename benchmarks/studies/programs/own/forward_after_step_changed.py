"""A policy sees joint angles and the fingertip, which mj_kinematics brings up to date."""

import mujoco
import numpy as np
from common import COUNT, REACHER, Stopwatch

model = mujoco.MjModel.from_xml_string(REACHER)
data = mujoco.MjData(model)
tip = data.site("tip").xpos
with Stopwatch():
    for _ in range(10 * COUNT):
        data.ctrl[0] = np.sin(data.time) - tip[0]
        mujoco.mj_step(model, data)
        mujoco.mj_kinematics(model, data)
