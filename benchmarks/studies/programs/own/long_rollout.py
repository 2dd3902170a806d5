"""One long rollout of many simulations on one thread."""

import mujoco
import numpy as np
from common import COUNT, REACHER, Stopwatch
from mujoco import rollout

model = mujoco.MjModel.from_xml_string(REACHER)
data = mujoco.MjData(model)
spec = mujoco.mjtState.mjSTATE_FULLPHYSICS
states = np.zeros((8, mujoco.mj_stateSize(model, spec)))
for state in states:
    mujoco.mj_getState(model, data, state, spec)
with Stopwatch():
    rollout.rollout(model, data, states, nstep=4 * COUNT)
