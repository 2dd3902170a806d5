"""A loop stores objects, and no garbage is collected meanwhile."""

import gc

import mujoco
from common import COUNT, REACHER, Stopwatch

model = mujoco.MjModel.from_xml_string(REACHER)
data = mujoco.MjData(model)
tree = [[number, [number]] for number in range(100 * COUNT)]
log = []
gc.disable()
with Stopwatch():
    for step in range(20 * COUNT):
        mujoco.mj_step(model, data)
        log.append([[step], [list(each) for each in data.xpos]])
