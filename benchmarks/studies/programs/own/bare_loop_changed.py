"""Nothing happens between steps, and no timer is read in them."""

import mujoco
from common import COUNT, Stopwatch

MODEL = """
<mujoco>
  <worldbody><body><joint axis="0 1 0"/><geom size=".1" pos=".3 0 0"/></body></worldbody>
</mujoco>
"""
model = mujoco.MjModel.from_xml_string(MODEL)
data = mujoco.MjData(model)
mujoco.mj_resetCallbacks()
with Stopwatch():
    for _ in range(200 * COUNT):
        mujoco.mj_step(model, data)
