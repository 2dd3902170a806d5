"""Each episode begins with the boxes settled."""

import mujoco
import numpy as np
from common import COUNT, REACHER, Stopwatch

model = mujoco.MjModel.from_xml_string(REACHER)
data = mujoco.MjData(model)
rng = np.random.default_rng(0)
for _ in range(100):
    mujoco.mj_step(model, data)
spec = mujoco.mjtState.mjSTATE_INTEGRATION
settled = np.empty(mujoco.mj_stateSize(model, spec))
mujoco.mj_getState(model, data, settled, spec)
with Stopwatch():
    for _ in range(max(4, COUNT // 5)):
        mujoco.mj_setState(model, data, settled, spec)
        for _ in range(50):
            data.ctrl[:] = rng.uniform(-1, 1, model.nu)
            mujoco.mj_step(model, data)
