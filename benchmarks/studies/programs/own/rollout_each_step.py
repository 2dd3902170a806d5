"""A policy steps 4 simulations by one rollout for each control, which starts threads anew."""

import mujoco
import numpy as np
from common import COUNT, REACHER, Stopwatch
from mujoco import rollout

model = mujoco.MjModel.from_xml_string(REACHER)
datas = [mujoco.MjData(model) for _ in range(2)]
spec = mujoco.mjtState.mjSTATE_FULLPHYSICS
states = np.zeros((4, mujoco.mj_stateSize(model, spec)))
for state in states:
    mujoco.mj_getState(model, datas[0], state, spec)
with Stopwatch():
    for _ in range(2 * COUNT):
        ends, _ = rollout.rollout(model, datas, states, nstep=1)
        states = ends[:, -1]
