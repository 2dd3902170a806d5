"""Every episode puts the model and the data on the device anew."""

import jax
import mujoco
from common import COUNT, Stopwatch
from mujoco import mjx

SWING = """
<mujoco>
  <worldbody>
    <body><joint axis="0 1 0"/><geom type="capsule" fromto="0 0 0 .5 0 0" size=".03"/></body>
  </worldbody>
</mujoco>
"""
model = mujoco.MjModel.from_xml_string(SWING)
data = mujoco.MjData(model)
steps = jax.jit(lambda mx, dx: jax.lax.fori_loop(0, 10, lambda _, d: mjx.step(mx, d), dx))
steps(mjx.put_model(model), mjx.put_data(model, data))  # compile
with Stopwatch():
    for episode in range(COUNT // 20):
        mujoco.mj_resetData(model, data)
        data.qpos[0] = 0.01 * episode
        mx, dx = mjx.put_model(model), mjx.put_data(model, data)
        steps(mx, dx).qpos.block_until_ready()
