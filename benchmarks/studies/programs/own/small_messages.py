"""A policy sends each control to a process, which takes one step and sends the state back."""

import multiprocessing

import mujoco
from common import COUNT, REACHER, Stopwatch

STEPS = 1


def simulate(pipe):
    """Take steps until the other end says that it is enough."""
    model = mujoco.MjModel.from_xml_string(REACHER)
    data = mujoco.MjData(model)
    while (control := pipe.recv()) is not None:
        data.ctrl[0] = control
        for _ in range(STEPS):
            mujoco.mj_step(model, data)
        pipe.send(data.qpos.copy())


if __name__ == "__main__":
    here, there = multiprocessing.Pipe()
    process = multiprocessing.get_context("fork").Process(target=simulate, args=(there,))
    process.start()
    with Stopwatch():
        for _ in range(10 * COUNT // STEPS):
            here.send(0.1)
            qpos = here.recv()
    here.send(None)
    process.join()
