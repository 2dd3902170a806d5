"""As rollout_of_one, with mj_step."""

import mujoco
from common import COUNT, REACHER, Stopwatch

model = mujoco.MjModel.from_xml_string(REACHER)
data = mujoco.MjData(model)
with Stopwatch():
    for _ in range(10 * COUNT):
        mujoco.mj_step(model, data)
