"""JAX compiles a new function in each iteration."""

import jax
import mujoco
from common import COUNT, Stopwatch
from mujoco import mjx

MODEL = """
<mujoco>
  <worldbody><body><joint axis="0 1 0"/><geom size=".1" pos=".3 0 0"/></body></worldbody>
</mujoco>
"""
model = mjx.put_model(mujoco.MjModel.from_xml_string(MODEL))
state = mjx.make_data(model)
with Stopwatch():
    for gain in range(max(4, COUNT // 500)):
        push = jax.jit(lambda d, gain=gain: mjx.step(model, d.replace(qvel=d.qvel + 0.01 * gain)))
        state = push(state)
    state.qpos.block_until_ready()
