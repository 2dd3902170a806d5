"""A loop that renders an image after each step."""

import sys

import mujoco

model = mujoco.MjModel.from_xml_path(sys.argv[1])
data = mujoco.MjData(model)
with mujoco.Renderer(model, 240, 320) as renderer:
    for _ in range(int(sys.argv[2])):
        mujoco.mj_step(model, data)
        renderer.update_scene(data)
        image = renderer.render()
print(image.shape)
