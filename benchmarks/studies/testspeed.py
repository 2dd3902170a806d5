"""mjwarp-testspeed, step by step: `python -m benchmarks.studies.testspeed MODEL FLAG…`.

It prints what mjwarp-testspeed prints, and then the seconds of each of its steps: its own figures
are means, also over the first step, in which the graph is loaded onto the GPU.
"""

import json
import sys
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np

from benchmarks import stored
from mjbench.simulation.workload import Workload

# Of mjwarp-testspeed's controls: the standard deviation of their noise as a share of half the range
# of an actuator, and the seconds over which it is correlated.
NOISE, NOISE_S = 0.01, 0.1


def noisy_keyframe(name: str, nbatch: int, nstep: int) -> Workload:
    """Return what mjwarp-testspeed steps of a shipped model: keyframe 0, noise on its controls."""
    model = stored.load(name)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    state = np.empty(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_INTEGRATION))
    mujoco.mj_getState(model, data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
    is_limited = model.actuator_ctrllimited.astype(bool)
    low, high = np.where(is_limited, model.actuator_ctrlrange.T, [[-np.inf], [np.inf]])
    correlation = np.exp(-model.opt.timestep / NOISE_S)
    scale = NOISE * np.sqrt(1 - correlation**2) * np.where(is_limited, (high - low) / 2, 1.0)
    control = np.empty((nbatch, nstep, model.nu))
    now = np.tile(data.ctrl, (nbatch, 1))
    for k in range(nstep):
        noise = [_halton((k + 1) * np.arange(1, nbatch + 1), 2 + i) for i in range(model.nu)]
        now = (
            correlation * now
            + (1 - correlation) * data.ctrl
            + scale * (2 * np.transpose(noise) - 1)
        )
        now = control[:, k] = np.clip(now, low, high)
    return Workload(model, np.tile(state, (nbatch, 1)), control, hold=1, seed=0)


def _halton(index: np.ndarray, base: int) -> np.ndarray:
    """Return members of the Halton sequence of a base: their digits, mirrored at the point."""
    value, share = np.zeros(len(index)), 1.0
    while index.any():
        share /= base
        value += share * (index % base)
        index = index // base
    return value


def main() -> None:
    """Run mjwarp-testspeed, which reads this process's arguments and ends the process."""
    from mujoco_warp import testspeed
    from mujoco_warp._src import cli

    unroll, steps_s = cli.unroll, []

    def unroll_and_record(
        function: Any, model: Any, data: Any, render: Any, callback: Callable[..., None], *rest: Any
    ) -> Any:
        def after_step(step: int, trace: Any, latency_s: float) -> None:
            steps_s.append(latency_s)
            callback(step, trace, latency_s)

        return unroll(function, model, data, render, after_step, *rest)

    cli.unroll = unroll_and_record
    try:
        testspeed.main()
    finally:
        sys.stdout.write(json.dumps({"steps_s": steps_s}) + "\n")


if __name__ == "__main__":
    main()
