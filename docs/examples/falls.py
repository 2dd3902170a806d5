"""How likely does the cart-pole fall, by initial angle? One question, answered in several ways.

    python docs/examples/falls.py [SAMPLES]

The pole starts at an angle, with small random offsets and velocities, and moves without control.
It has fallen when the hinge passes 0.5 rad within a second. A Python loop, `mujoco.rollout` and
`mujoco.batch` (MuJoCo 3.17 and newer) must all count the same falls; only then are their times
compared.
"""

import math
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
from mujoco import rollout

try:
    from mujoco import batch
except ImportError:
    batch = None

MODEL = mujoco.MjModel.from_xml_path(str(Path(__file__).parents[2] / "models/cartpole.xml"))
HINGE = int(MODEL.joint("hinge").qposadr[0])
NSTEP = round(1.0 / MODEL.opt.timestep)
FALLEN_RAD = 0.5
ANGLES_RAD = [0.05 * i for i in range(9)]
# Standard deviations of the random starts: positions in m and rad, velocities per second.
POSITION_SD, VELOCITY_SD = 0.02, 0.2
STATE = mujoco.mjtState.mjSTATE_FULLPHYSICS
# Returns (nbatch,) whether the pole falls from each of (nbatch, nstate) start states.
Way = Callable[[np.ndarray], np.ndarray]


def starts(samples: int) -> np.ndarray:
    """Return (angles * samples, nstate) start states, angle by angle."""
    rng, data = np.random.default_rng(0), mujoco.MjData(MODEL)
    rows = np.empty((len(ANGLES_RAD) * samples, mujoco.mj_stateSize(MODEL, STATE)))
    for i, row in enumerate(rows):
        mujoco.mj_resetData(MODEL, data)
        data.qpos[:] += POSITION_SD * rng.standard_normal(MODEL.nq)
        data.qvel[:] += VELOCITY_SD * rng.standard_normal(MODEL.nv)
        data.qpos[HINGE] += ANGLES_RAD[i // samples]
        mujoco.mj_getState(MODEL, data, row, STATE)
    return rows


def by_loop(initial: np.ndarray) -> np.ndarray:
    """Step one simulation after the other."""
    data, fallen = mujoco.MjData(MODEL), np.zeros(len(initial), dtype=bool)
    for i, row in enumerate(initial):
        mujoco.mj_resetData(MODEL, data)
        mujoco.mj_setState(MODEL, data, row, STATE)
        for _ in range(NSTEP):
            mujoco.mj_step(MODEL, data)
            fallen[i] |= abs(data.qpos[HINGE]) > FALLEN_RAD
    return fallen


def by_rollout(initial: np.ndarray) -> np.ndarray:
    """Step all in one call, on one thread for each core."""
    datas = [mujoco.MjData(MODEL) for _ in range(os.cpu_count() or 1)]
    states, _ = rollout.rollout(MODEL, datas, initial, nstep=NSTEP)
    return _fell(states[:, :, 1 + HINGE])  # the first entry of a state is the time


def by_batch(initial: np.ndarray) -> np.ndarray:
    """Step all in one call that keeps positions alone."""
    stepper = batch.Batch(MODEL, len(initial), os.cpu_count() or 1)
    stepper.reset()
    stepper.qpos[:] = initial[:, 1 : 1 + MODEL.nq]
    stepper.qvel[:] = initial[:, 1 + MODEL.nq : 1 + MODEL.nq + MODEL.nv]
    return _fell(stepper.rollout(NSTEP, None, record=("qpos",))["qpos"][:, :, HINGE])


def _fell(angles_rad: np.ndarray) -> np.ndarray:
    return (np.abs(angles_rad) > FALLEN_RAD).any(axis=1)


WAYS: dict[str, Way] = {"loop": by_loop, "rollout": by_rollout}
if batch is not None:
    WAYS["batch"] = by_batch


def wilson(successes: int, trials: int) -> tuple[float, float]:
    """Return the 95 % score interval of a proportion (Wilson, JASA 22, 1927)."""
    z = 1.959964
    share, growth = successes / trials, 1 + z * z / trials
    centre = (share + z * z / (2 * trials)) / growth
    half = z / growth * math.sqrt(share * (1 - share) / trials + z * z / (4 * trials**2))
    return max(0.0, centre - half), min(1.0, centre + half)


def main(samples: int) -> None:
    """Count in every way; print the falls by angle, and the time that each way took."""
    initial, counts = starts(samples), {}
    for name, way in WAYS.items():
        begin = time.perf_counter()
        counts[name] = way(initial).reshape(-1, samples).sum(axis=1).tolist()
        print(f"{name:8} {time.perf_counter() - begin:.3f} s")
        if counts[name] != counts["loop"]:
            sys.exit(f"{name} counts {counts[name]} falls, the loop {counts['loop']}")
    for angle_rad, falls in zip(ANGLES_RAD, counts["loop"], strict=True):
        low, high = wilson(falls, samples)
        share = falls / samples
        bar = "█" * round(40 * share)
        print(f"{angle_rad:.2f} rad  {share:.3f} ({low:.3f} to {high:.3f})  {bar}")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 1000)
