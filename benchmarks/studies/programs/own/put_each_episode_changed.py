"""The model and its data are on the device; each episode replaces the positions."""

import jax
import mujoco
from common import COUNT, Stopwatch
from mujoco import mjx

MODEL = """
<mujoco>
  <worldbody><body><joint axis="0 1 0"/><geom size=".1" pos=".3 0 0"/></body></worldbody>
</mujoco>
"""
model = mujoco.MjModel.from_xml_string(MODEL)
step = jax.jit(mjx.step)
device_model, first = mjx.put_model(model), mjx.put_data(model, mujoco.MjData(model))
step(device_model, first)  # compiles
with Stopwatch():
    for episode in range(max(4, COUNT // 15)):
        state = first.replace(qpos=first.qpos.at[0].set(0.01 * episode))
        for _ in range(5):
            state = step(device_model, state)
        state.qpos.block_until_ready()
