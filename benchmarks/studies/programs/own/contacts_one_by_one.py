"""A loop over all contacts, each of which becomes an object of Python."""

import mujoco
from common import COUNT, REACHER, Stopwatch

model = mujoco.MjModel.from_xml_string(REACHER)
data = mujoco.MjData(model)
depth = 0.0
with Stopwatch():
    for _ in range(10 * COUNT):
        mujoco.mj_step(model, data)
        for contact in data.contact:
            depth += contact.dist
