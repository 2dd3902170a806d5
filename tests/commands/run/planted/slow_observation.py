"""A loop whose observation is computed in Python, element by element."""

import sys

import mujoco

MODEL = mujoco.MjModel.from_xml_path(sys.argv[1])
DATA = mujoco.MjData(MODEL)


def observe():
    total = 0.0
    for _ in range(20):
        for value in range(60):
            total += value * 0.5
    return total + DATA.time


def main(nstep):
    score = 0.0
    for _ in range(nstep):
        mujoco.mj_step(MODEL, DATA)
        score += observe()
    print("score", score > 0)


main(int(sys.argv[2]))
sys.exit(7)
