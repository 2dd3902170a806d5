"""A controller linearizes each state by a step for each number of it."""

import mujoco
import numpy as np
from common import COUNT, REACHER, Stopwatch

model = mujoco.MjModel.from_xml_string(REACHER)
data = mujoco.MjData(model)
spec = mujoco.mjtState.mjSTATE_FULLPHYSICS
state = np.empty(mujoco.mj_stateSize(model, spec))
A = np.empty((2 * model.nv, 2 * model.nv))
B = np.empty((2 * model.nv, model.nu))
end = np.empty(model.nv)
EPS = 1e-6


def following(start):
    """Return the position and the velocity after a step, of which that at the start is left out."""
    mujoco.mj_step(model, data)
    mujoco.mj_differentiatePos(model, end, 1, start, data.qpos)
    return np.concatenate([end, data.qvel])


with Stopwatch():
    for _ in range(COUNT // 4):
        mujoco.mj_getState(model, data, state, spec)
        start = data.qpos.copy()
        first = following(start)
        for i in range(model.nv):
            mujoco.mj_setState(model, data, state, spec)
            shift = np.zeros(model.nv)
            shift[i] = EPS
            mujoco.mj_integratePos(model, data.qpos, shift, 1)
            A[:, i] = (following(start) - first) / EPS
        for i in range(model.nv):
            mujoco.mj_setState(model, data, state, spec)
            data.qvel[i] += EPS
            A[:, model.nv + i] = (following(start) - first) / EPS
        for i in range(model.nu):
            mujoco.mj_setState(model, data, state, spec)
            data.ctrl[i] += EPS
            B[:, i] = (following(start) - first) / EPS
        mujoco.mj_setState(model, data, state, spec)
        mujoco.mj_step(model, data)
