"""Several simulations are stepped one after another."""

import mujoco
from common import COUNT, REACHER, Stopwatch

model = mujoco.MjModel.from_xml_string(REACHER)
simulations = [mujoco.MjData(model) for _ in range(8)]
with Stopwatch():
    for _ in range(2 * COUNT):
        for data in simulations:
            mujoco.mj_step(model, data)
