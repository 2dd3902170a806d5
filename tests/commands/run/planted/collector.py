"""A loop beside a heap of objects that the garbage collector searches again and again."""

import gc
import sys

import mujoco

model = mujoco.MjModel.from_xml_path(sys.argv[1])
data = mujoco.MjData(model)
heap = [[number] for number in range(400_000)]
for step in range(int(sys.argv[2])):
    mujoco.mj_step(model, data)
    if step % 100 == 0:
        gc.collect()
print(len(heap))
