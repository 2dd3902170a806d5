"""One long rollout of many simulations on two threads."""

import mujoco
import numpy as np
from common import COUNT, REACHER, Stopwatch
from mujoco import rollout

model = mujoco.MjModel.from_xml_string(REACHER)
datas = [mujoco.MjData(model) for _ in range(2)]
spec = mujoco.mjtState.mjSTATE_FULLPHYSICS
states = np.zeros((8, mujoco.mj_stateSize(model, spec)))
for state in states:
    mujoco.mj_getState(model, datas[0], state, spec)
with Stopwatch():
    rollout.rollout(model, datas, states, nstep=4 * COUNT)
