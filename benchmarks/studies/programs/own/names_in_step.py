"""A policy looks up all joints by name in each step."""

import mujoco
from common import COUNT, REACHER, Stopwatch

model = mujoco.MjModel.from_xml_string(REACHER)
data = mujoco.MjData(model)
names = ["shoulder", "elbow"] * 5
with Stopwatch():
    for _ in range(15 * COUNT):
        mujoco.mj_step(model, data)
        data.ctrl[0] = -sum(data.joint(name).qpos[0] for name in names)
