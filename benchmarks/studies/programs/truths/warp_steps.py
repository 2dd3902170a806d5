"""Parts of a step of MuJoCo Warp, called from Python."""

import mujoco
import mujoco_warp
import numpy as np
import warp

MODEL = mujoco.MjModel.from_xml_string("""
<mujoco>
  <worldbody>
    <geom type="plane" size="5 5 .1"/>
    <body pos="0 0 1">
      <joint type="hinge" axis="0 1 0"/>
      <geom type="capsule" size=".05 .2"/>
    </body>
  </worldbody>
</mujoco>
""")
ON_DEVICE = mujoco_warp.put_model(MODEL)
DATA = mujoco_warp.make_data(MODEL, nworld=8)


def collide() -> np.ndarray:
    """Find contacts, by kernels that are made, or looked up, in Python."""
    mujoco_warp.collision(ON_DEVICE, DATA)
    warp.synchronize()
    return DATA.nacon.numpy()


def kinematics() -> np.ndarray:
    """Compute where bodies are, by kernels that were compiled once."""
    mujoco_warp.kinematics(ON_DEVICE, DATA)
    warp.synchronize()
    return DATA.xpos.numpy()
