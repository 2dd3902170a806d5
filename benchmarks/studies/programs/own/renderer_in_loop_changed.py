"""One renderer draws all frames."""

import mujoco
import numpy as np
from common import COUNT, REACHER, Stopwatch

model = mujoco.MjModel.from_xml_string(REACHER)
data = mujoco.MjData(model)
with Stopwatch():
    renderer = mujoco.Renderer(model, 48, 64)
    for _ in range(max(4, COUNT // 150)):
        for _ in range(10):
            mujoco.mj_step(model, data)
        renderer.update_scene(data)
        brightness = np.mean(renderer.render())
