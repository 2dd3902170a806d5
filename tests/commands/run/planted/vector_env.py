"""Four processes that step a simulation each, and one that waits for all of them at every step."""

import multiprocessing
import sys

import mujoco


def work(path, pipe):
    model = mujoco.MjModel.from_xml_path(path)
    data = mujoco.MjData(model)
    while (nstep := pipe.recv()) is not None:
        mujoco.mj_step(model, data, nstep)
        pipe.send(data.qpos.copy())


def main(path, count):
    context = multiprocessing.get_context(sys.argv[3])
    pipes, processes = [], []
    for _ in range(4):
        here, there = context.Pipe()
        processes.append(context.Process(target=work, args=(path, there)))
        processes[-1].start()
        pipes.append(here)
    for _ in range(count):
        for pipe in pipes:
            pipe.send(1)
        states = [pipe.recv() for pipe in pipes]
    for pipe, process in zip(pipes, processes, strict=True):
        pipe.send(None)
        process.join()
    print(len(states))


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
