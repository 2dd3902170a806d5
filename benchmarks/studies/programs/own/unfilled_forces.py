"""Contact forces of bodies are logged, which nothing computes."""

import mujoco
from common import COUNT, REACHER, Stopwatch

model = mujoco.MjModel.from_xml_string(REACHER)
data = mujoco.MjData(model)
total = 0.0
with Stopwatch():
    for _ in range(10 * COUNT):
        mujoco.mj_step(model, data)
        total += data.cfrc_ext[1, 5]
