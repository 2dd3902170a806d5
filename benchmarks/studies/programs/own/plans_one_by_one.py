"""A planner scores its plans one after the other; they are known before the steps."""

import mujoco
import numpy as np
from common import COUNT, REACHER, Stopwatch

SPEC = mujoco.mjtState.mjSTATE_FULLPHYSICS


def score(model, data, start, plan):
    """Return what a plan costs."""
    mujoco.mj_setState(model, data, start, SPEC)
    cost = 0.0
    for action in plan:
        data.ctrl[:] = action
        mujoco.mj_step(model, data)
        cost += data.qpos[0] ** 2
    return cost


model = mujoco.MjModel.from_xml_string(REACHER)
data = mujoco.MjData(model)
rng = np.random.default_rng(0)
start = np.empty(mujoco.mj_stateSize(model, SPEC))
mujoco.mj_getState(model, data, start, SPEC)
with Stopwatch():
    for _ in range(max(2, COUNT // 20)):
        plans = rng.uniform(-1, 1, (32, 25, model.nu))
        costs = [score(model, data, start, plan) for plan in plans]
