"""Each episode puts the model and its data on the device again."""

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
step(mjx.put_model(model), mjx.put_data(model, mujoco.MjData(model)))  # compiles
with Stopwatch():
    for episode in range(max(4, COUNT // 15)):
        data = mujoco.MjData(model)
        data.qpos[0] = 0.01 * episode
        device_model = mjx.put_model(model)
        state = mjx.put_data(model, data)
        for _ in range(5):
            state = step(device_model, state)
        state.qpos.block_until_ready()
