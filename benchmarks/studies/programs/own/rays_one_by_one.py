"""A robot with a range finder, whose rays are cast one by one."""

import mujoco
import numpy as np
from common import COUNT, REACHER, Stopwatch

model = mujoco.MjModel.from_xml_string(REACHER)
data = mujoco.MjData(model)
geom = np.zeros(1, dtype=np.int32)
angles = 2 * np.pi * np.arange(36) / 36
with Stopwatch():
    for _ in range(5 * COUNT):
        mujoco.mj_step(model, data)
        origin, scan = data.site_xpos[0], []
        for angle in angles:
            direction = np.array([np.cos(angle), np.sin(angle), 0.0])
            scan.append(mujoco.mj_ray(model, data, origin, direction, None, 1, -1, geom))
        data.ctrl[0] = 0.1 * min(scan)
