"""A loop that waits for four processes, each of which takes 20 steps, until the side is `ENDED`."""

import multiprocessing
import os
import sys
from multiprocessing.connection import Connection
from pathlib import Path

import mujoco
from side import Side

NSTEP, PROCESSES = 20, 4


def work(path: str, file: str, pipe: Connection, core: int) -> None:
    """Step a model when asked to, on one core.

    Where Linux chooses cores, such a loop takes much longer in one run than in another.
    """
    os.sched_setaffinity(0, [core])
    side = Side(Path(file))
    model = mujoco.MjModel.from_xml_path(path)
    data = mujoco.MjData(model)
    while nstep := pipe.recv():
        step = side.step
        for _ in range(nstep):
            step(model, data)
        if data.time > 20:
            mujoco.mj_resetData(model, data)
        pipe.send(data.qpos.copy())


def main(path: str, file: str) -> None:
    """Start the processes, and wait for them."""
    pairs = [multiprocessing.Pipe() for _ in range(PROCESSES)]
    pipes = [here for here, _ in pairs]
    cores = sorted(os.sched_getaffinity(0)) * PROCESSES
    for (_, there), core in zip(pairs, cores, strict=False):
        multiprocessing.Process(target=work, args=(path, file, there, core)).start()

    def block() -> int:
        for _ in range(10):
            for pipe in pipes:
                pipe.send(NSTEP)
            for pipe in pipes:
                pipe.recv()
        return 10 * NSTEP * PROCESSES

    Side(Path(file)).run(block)
    for pipe in pipes:
        pipe.send(0)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2])
