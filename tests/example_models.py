"""Small models that several tests share."""

import mujoco
import numpy as np

# The least that moves: an engine that compiles needs no solver of constraints for it.
PENDULUM_XML = """
<mujoco>
  <worldbody>
    <body>
      <joint name="hinge" axis="0 1 0" damping="0.0005"/>
      <geom type="capsule" size="0.02" fromto="0 0 0 0 0 0.6" mass="0.2"/>
    </body>
  </worldbody>
  <actuator><motor joint="hinge" ctrlrange="-1 1" ctrllimited="true"/></actuator>
</mujoco>
"""

# A box resting on the floor, a motor-driven arm, and a mocap body away from its default pose.
CONTACT_XML = """
<mujoco>
  <worldbody>
    <geom type="plane" size="1 1 1"/>
    <body name="target" mocap="true" pos="0 0 2"/>
    <body pos="0 0 .1"><freejoint/><geom type="box" size=".1 .1 .1"/></body>
    <body pos="1 0 .5">
      <joint name="arm" type="hinge" axis="0 1 0"/>
      <geom type="capsule" size=".05" fromto="0 0 0 .3 0 0"/>
    </body>
  </worldbody>
  <actuator><motor joint="arm" ctrlrange="-1 1" ctrllimited="true"/></actuator>
  <sensor><jointpos joint="arm"/></sensor>
  <keyframe><key qpos="0 0 .098 1 0 0 0 .1" ctrl=".2" mpos="0 0 3"/></keyframe>
</mujoco>
"""


# Boxes that touch, a sphere apart, and sensors of which one kind casts rays.
COSTS_XML = """
<mujoco>
  <worldbody>
    <geom name="floor" type="plane" size="5 5 .1"/>
    <body pos="0 0 .1"><freejoint/><geom name="a" type="box" size=".1 .1 .1"/></body>
    <body pos=".15 0 .25"><freejoint/><geom name="b" type="box" size=".1 .1 .1"/></body>
    <body pos="3 0 .1"><freejoint/><geom name="c" size=".1"/><site name="s"/></body>
  </worldbody>
  <sensor><gyro site="s"/><rangefinder site="s"/><rangefinder site="s"/></sensor>
</mujoco>"""


def initial_states(model: mujoco.MjModel, count: int) -> np.ndarray:
    """Return the state that the model begins with, (count, nstate) times."""
    data, spec = mujoco.MjData(model), mujoco.mjtState.mjSTATE_INTEGRATION
    rows = np.empty((count, mujoco.mj_stateSize(model, spec)))
    for row in rows:
        mujoco.mj_getState(model, data, row, spec)
    return rows
