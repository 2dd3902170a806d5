"""A loop that stores views, so that every row of its log is the last state."""

import sys

import mujoco

model = mujoco.MjModel.from_xml_path(sys.argv[1])
data = mujoco.MjData(model)
log = []
for _ in range(int(sys.argv[2])):
    mujoco.mj_step(model, data)
    log.append(data.qpos)
print(len(log))
