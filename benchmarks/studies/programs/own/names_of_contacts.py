"""The names of both geoms of each contact, in each step."""

import mujoco
from common import COUNT, REACHER, Stopwatch

model = mujoco.MjModel.from_xml_string(REACHER)
data = mujoco.MjData(model)
touches = 0
with Stopwatch():
    for _ in range(15 * COUNT):
        mujoco.mj_step(model, data)
        for i in range(data.ncon):
            contact = data.contact[i]
            names = model.geom(contact.geom1).name, model.geom(contact.geom2).name
            touches += "floor" in names
