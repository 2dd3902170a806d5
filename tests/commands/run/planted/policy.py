"""A loop whose policy is a network of PyTorch."""

import sys

import mujoco
import torch

model = mujoco.MjModel.from_xml_path(sys.argv[1])
data = mujoco.MjData(model)
policy = torch.nn.Sequential(
    torch.nn.Linear(model.nq, 256), torch.nn.Tanh(), torch.nn.Linear(256, max(1, model.nu))
)
for _ in range(int(sys.argv[2])):
    with torch.no_grad():
        action = policy(torch.as_tensor(data.qpos, dtype=torch.float32))
    data.ctrl[:] = action.numpy()[: model.nu]
    mujoco.mj_step(model, data)
print(data.time > 0)
