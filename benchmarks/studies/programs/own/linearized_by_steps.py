"""The derivatives of a step by positions and velocities, with a step for each."""

import mujoco
import numpy as np
from common import COUNT, REACHER, Stopwatch

model = mujoco.MjModel.from_xml_string(REACHER)
data = mujoco.MjData(model)
nv, eps, spec = model.nv, 1e-6, mujoco.mjtState.mjSTATE_INTEGRATION
state, matrix = np.empty(mujoco.mj_stateSize(model, spec)), np.zeros((2 * nv, 2 * nv))
position, velocity, move = np.empty(model.nq), np.empty(nv), np.empty(nv)


def linearize() -> None:
    """Write the matrix; the MjData stays as it is."""
    mujoco.mj_getState(model, data, state, spec)
    mujoco.mj_step(model, data)
    position[:], velocity[:] = data.qpos, data.qvel
    for i in range(nv):
        mujoco.mj_setState(model, data, state, spec)
        move[:] = 0
        move[i] = eps
        mujoco.mj_integratePos(model, data.qpos, move, 1)
        mujoco.mj_step(model, data)
        mujoco.mj_differentiatePos(model, move, eps, position, data.qpos)
        matrix[:nv, i], matrix[nv:, i] = move, (data.qvel - velocity) / eps
    for i in range(nv):
        mujoco.mj_setState(model, data, state, spec)
        data.qvel[i] += eps
        mujoco.mj_step(model, data)
        mujoco.mj_differentiatePos(model, move, eps, position, data.qpos)
        matrix[:nv, nv + i], matrix[nv:, nv + i] = move, (data.qvel - velocity) / eps
    mujoco.mj_setState(model, data, state, spec)


with Stopwatch():
    for _ in range(COUNT // 4):
        mujoco.mj_step(model, data)
        linearize()
