"""As device_per_episode, with one model and one state that others replace."""

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
mx, first = mjx.put_model(model), mjx.put_data(model, data)
steps(mx, first.replace(qpos=first.qpos.at[0].set(0.0)))  # compile
with Stopwatch():
    for episode in range(COUNT // 20):
        dx = first.replace(qpos=first.qpos.at[0].set(0.01 * episode))
        steps(mx, dx).qpos.block_until_ready()
