"""A policy steps one simulation by a rollout of one step."""

import mujoco
import numpy as np
from common import COUNT, REACHER, Stopwatch
from mujoco import rollout

model = mujoco.MjModel.from_xml_string(REACHER)
data = mujoco.MjData(model)
spec = mujoco.mjtState.mjSTATE_FULLPHYSICS
state = np.zeros(mujoco.mj_stateSize(model, spec))
mujoco.mj_getState(model, data, state, spec)
control = np.zeros((1, model.nu))
with Stopwatch():
    for _ in range(10 * COUNT):
        states, _ = rollout.rollout(model, data, state, control)
        state = states[0, -1]
