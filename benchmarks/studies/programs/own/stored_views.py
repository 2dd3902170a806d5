"""A log of views, which a helper returns: all of its rows are the last state."""

import mujoco
from common import COUNT, REACHER, Stopwatch


def snapshot(data):
    """Return what is logged of a state."""
    return {"qpos": data.qpos, "time": data.time}


model = mujoco.MjModel.from_xml_string(REACHER)
data = mujoco.MjData(model)
log = []
with Stopwatch():
    for _ in range(10 * COUNT):
        mujoco.mj_step(model, data)
        log.append(snapshot(data))
