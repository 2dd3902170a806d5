"""Two processes compute a policy in NumPy, whose BLAS starts a thread for each core in both."""

import multiprocessing

import mujoco
import numpy as np
from common import COUNT, REACHER, Stopwatch

SIZE = 512


def collect(number):
    """Step with a policy."""
    model = mujoco.MjModel.from_xml_string(REACHER)
    data = mujoco.MjData(model)
    weights = np.random.default_rng(number).normal(size=(SIZE, SIZE)) / SIZE
    inputs = np.ones((SIZE, 16))
    for _ in range(COUNT):
        inputs[0, 0] = data.qpos[0]
        for _ in range(3):
            outputs = np.tanh(weights @ inputs)
        data.ctrl[0] = outputs[0, 0]
        mujoco.mj_step(model, data)


if __name__ == "__main__":
    context = multiprocessing.get_context("fork")
    workers = [context.Process(target=collect, args=(number,)) for number in range(2)]
    with Stopwatch():
        for worker in workers:
            worker.start()
        for worker in workers:
            worker.join()
