"""A planner scores its plans at once, on threads."""

import os

import mujoco
import numpy as np
from common import COUNT, REACHER, Stopwatch
from mujoco import rollout

SPEC = mujoco.mjtState.mjSTATE_FULLPHYSICS
model = mujoco.MjModel.from_xml_string(REACHER)
data = mujoco.MjData(model)
rng = np.random.default_rng(0)
start = np.empty(mujoco.mj_stateSize(model, SPEC))
mujoco.mj_getState(model, data, start, SPEC)
cores = len(os.sched_getaffinity(0))
datas = [mujoco.MjData(model) for _ in range(cores)]
with rollout.Rollout(nthread=cores) as pool, Stopwatch():
    for _ in range(max(2, COUNT // 20)):
        plans = rng.uniform(-1, 1, (32, 25, model.nu))
        states, _ = pool.rollout(model, datas, np.tile(start, (32, 1)), plans)
        costs = (states[:, :, 1] ** 2).sum(axis=1)
