"""All episodes have one model, whose boxes would be moved away where they are not needed."""

import mujoco
from common import COUNT, REACHER, Stopwatch


def scene(boxes):
    """Return a reacher among boxes."""
    spec = mujoco.MjSpec.from_string(REACHER)
    for i in range(boxes):
        body = spec.worldbody.add_body(pos=[1 + 0.2 * i, 0, 0])
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.03, 0.03, 0.03])
    return spec.compile()


with Stopwatch():
    model = scene(2)
    for _ in range(max(4, COUNT // 10)):
        data = mujoco.MjData(model)
        for _ in range(100):
            mujoco.mj_step(model, data)
