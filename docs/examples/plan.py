"""Swing up the cart-pole by MPPI: a sampling planner whose candidates `mujoco.rollout` steps.

    python docs/examples/plan.py [SECONDS]

The pole hangs down. For each control, the planner draws candidates, sequences of controls around
the best so far, rolls all of them out from the same state, and takes their mean, weighted by
exp(-cost / temperature) (Williams et al. 2017, arXiv:1707.02342, equation 31). Then the model goes
on with the plan's first control. It prints plans per second, and whether the pole stands.
"""

import os
import sys
import time
from pathlib import Path

import mujoco
import numpy as np
from mujoco import rollout

MODEL = mujoco.MjModel.from_xml_path(str(Path(__file__).parents[2] / "models/cartpole.xml"))
LOW, HIGH = MODEL.actuator_ctrlrange.T
STATE = mujoco.mjtState.mjSTATE_FULLPHYSICS
# Candidates of a plan, controls of each, and steps for which a control is held.
SAMPLES, KNOTS, HOLD = 64, 10, 20
# Noise of the candidates as a share of half the control range, and the temperature as a share of
# the standard deviation of their costs.
NOISE, TEMPERATURE = 0.5, 0.1
# The pole stands if it is within this angle of upright, in rad.
UPRIGHT_RAD = np.radians(15)


class Planner:
    """Improves a plan, (KNOTS, nu) controls, from the state of a simulation."""

    def __init__(self, threads: int, seed: int = 0) -> None:
        self._datas = [mujoco.MjData(MODEL) for _ in range(threads)]
        self._pool = rollout.Rollout(nthread=threads)
        self._rng = np.random.default_rng(seed)
        self.plan = np.zeros((KNOTS, MODEL.nu))

    def __enter__(self) -> "Planner":
        return self

    def __exit__(self, *_: object) -> None:
        self._pool.close()

    def improve(self, data: mujoco.MjData) -> None:
        """Draw candidates, roll them out from the present state, and take their weighted mean."""
        noise = self._rng.standard_normal((SAMPLES, KNOTS, MODEL.nu))
        noise[0] = 0.0  # one candidate is the plan itself
        candidates = np.clip(self.plan + NOISE * 0.5 * (HIGH - LOW) * noise, LOW, HIGH)
        costs = self._costs(data, candidates)
        weights = np.exp(-(costs - costs.min()) / max(TEMPERATURE * costs.std(), 1e-12))
        self.plan = np.tensordot(weights / weights.sum(), candidates, axes=1)

    def advance(self) -> np.ndarray:
        """Return the plan's first control, and shift the plan by it."""
        control = self.plan[0].copy()
        self.plan = np.vstack([self.plan[1:], self.plan[-1:]])
        return control

    def _costs(self, data: mujoco.MjData, candidates: np.ndarray) -> np.ndarray:
        """Return (SAMPLES,) costs of (SAMPLES, KNOTS, nu) controls."""
        start = np.empty(mujoco.mj_stateSize(MODEL, STATE))
        mujoco.mj_getState(MODEL, data, start, STATE)
        controls = np.repeat(candidates, HOLD, axis=1)
        states, _ = self._pool.rollout(MODEL, self._datas, np.tile(start, (SAMPLES, 1)), controls)
        qpos, qvel = np.split(states[:, :, 1 : 1 + MODEL.nq + MODEL.nv], [MODEL.nq], axis=2)
        running = 1 - np.cos(qpos[..., 1]) + 0.1 * qpos[..., 0] ** 2 + 0.01 * (qvel**2).sum(axis=2)
        return running.mean(axis=1) + 0.01 * (candidates**2).mean(axis=(1, 2))


def swing_up(seconds: float, threads: int) -> tuple[np.ndarray, float]:
    """Return the angles of the pole after each control, in rad, and the plans per second."""
    data = mujoco.MjData(MODEL)
    data.qpos[:] = (0.0, np.pi)
    nplan = round(seconds / (HOLD * MODEL.opt.timestep))
    angles_rad, planning_s = np.empty(nplan), 0.0
    with Planner(threads) as planner:
        for i in range(nplan):
            begin = time.perf_counter()
            planner.improve(data)
            planning_s += time.perf_counter() - begin
            data.ctrl[:] = planner.advance()
            mujoco.mj_step(MODEL, data, HOLD)
            angles_rad[i] = data.qpos[1]
    return angles_rad, nplan / planning_s


def main(seconds: float, threads: int | None = None) -> None:
    """Swing up, and print how it went."""
    angles_rad, plans_per_s = swing_up(seconds, threads or os.cpu_count() or 1)
    last = angles_rad[-(len(angles_rad) // 4 or 1) :]
    stands = bool((np.cos(last) > np.cos(UPRIGHT_RAD)).all())
    needed = 1 / (HOLD * MODEL.opt.timestep)
    print(f"{len(angles_rad)} plans, {plans_per_s:.0f} per second; real time needs {needed:.0f}")
    print(f"the pole {'stands' if stands else 'does not stand'} in the last quarter")


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 3.0)
