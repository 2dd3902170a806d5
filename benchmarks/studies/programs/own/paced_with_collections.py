"""A loop that keeps real time, beside a large tree of objects that collections of garbage visit."""

import time

import mujoco
from common import COUNT, REACHER, Stopwatch

model = mujoco.MjModel.from_xml_string(REACHER)
data = mujoco.MjData(model)
tree = [[number, [number]] for number in range(100 * COUNT)]
log = []
with Stopwatch():
    next_s = time.perf_counter()
    for _ in range(COUNT // 12):
        mujoco.mj_step(model, data)
        log.append([[list(each) for each in data.xmat] for _ in range(100)])
        next_s += model.opt.timestep
        time.sleep(max(0.0, next_s - time.perf_counter()))
