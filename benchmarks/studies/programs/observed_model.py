"""A loop around `mj_step` with a small observation, until the side is `ENDED`."""

import sys
from pathlib import Path

import mujoco
import numpy as np
from side import Side

side = Side(Path(sys.argv[2]))
model = mujoco.MjModel.from_xml_path(sys.argv[1])
data = mujoco.MjData(model)


def block() -> int:
    """Take 100 steps."""
    step = side.step
    for _ in range(100):
        step(model, data)
        np.concatenate([data.qpos, data.qvel])
    if data.time > 20:
        mujoco.mj_resetData(model, data)
    return 100


side.run(block)
