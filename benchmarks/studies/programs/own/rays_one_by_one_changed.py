"""A robot with a range finder, whose rays are cast in one call."""

import mujoco
import numpy as np
from common import COUNT, REACHER, Stopwatch

from mjbench.simulation.compat import cast_rays

model = mujoco.MjModel.from_xml_string(REACHER)
data = mujoco.MjData(model)
geoms, scan = np.zeros(36, dtype=np.int32), np.zeros(36)
angles = 2 * np.pi * np.arange(36) / 36
directions = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
with Stopwatch():
    for _ in range(5 * COUNT):
        mujoco.mj_step(model, data)
        cast_rays(model, data, data.site_xpos[0], directions, geoms, scan)
        data.ctrl[0] = 0.1 * scan.min()
