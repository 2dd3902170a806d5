"""Several simulations are stepped at once, on all cores."""

import mujoco
from common import COUNT, REACHER, Stopwatch
from mujoco.batch import Batch

model = mujoco.MjModel.from_xml_string(REACHER)
batch = Batch(model, 8)
with Stopwatch():
    for _ in range(2 * COUNT):
        batch.step()
