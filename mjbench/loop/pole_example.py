"""How likely the cart-pole falls, from each initial angle: one question, asked by every path.

The pole starts at an angle with random small offsets and velocities and is left alone. It has
fallen when the hinge passes 0.5 rad within a second. Every path must count the same falls; only
then are their times compared.
"""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from mjbench.errors import InputError, MachineError
from mjbench.simulation import compat, models

FALLEN_RAD, WITHIN_S = 0.5, 1.0
# Standard deviations of the random starts: positions in m and rad, velocities per second.
POSITION_SD, VELOCITY_SD = 0.02, 0.2
ANGLES = tuple(round(0.05 * i, 2) for i in range(9))


@dataclass(frozen=True)
class Way:
    """A way of asking, and how long it took.

    Attributes:
      name: what it is called.
      counts: falls at each angle.
      seconds: of stepping, everything made beforehand.
      threads: that it used.
    """

    name: str
    counts: tuple[int, ...]
    seconds: float
    threads: int


@dataclass(frozen=True)
class Result:
    """Falls of the cart-pole.

    Attributes:
      angles: initial angles, rad.
      samples: starts for each angle.
      ways: the loop first.
    """

    angles: tuple[float, ...]
    samples: int
    ways: tuple[Way, ...]

    def intervals(self, confidence: float = 0.95) -> list[tuple[float, float, float]]:
        """Return (probability, low, high) at each angle."""
        return [wilson(count, self.samples, confidence) for count in self.ways[0].counts]


def wilson(successes: int, trials: int, confidence: float = 0.95) -> tuple[float, float, float]:
    """Return a proportion with its score interval (Wilson, JASA 22, 1927).

    Raises:
      ValueError: counts that cannot be.
    """
    from statistics import NormalDist

    if not 0 <= successes <= trials or trials < 1:
        raise ValueError(f"{successes} of {trials}")
    z = NormalDist().inv_cdf((1 + confidence) / 2)
    share, growth = successes / trials, 1 + z * z / trials
    centre = (share + z * z / (2 * trials)) / growth
    half = z / growth * math.sqrt(share * (1 - share) / trials + z * z / (4 * trials**2))
    return share, max(0.0, centre - half), min(1.0, centre + half)


def starts(model: Any, angles: Sequence[float], samples: int, seed: int) -> np.ndarray:
    """Return (len(angles) * samples, nstate) rows of mjSTATE_INTEGRATION, angle by angle."""
    spec = compat.state_spec("INTEGRATION")
    rng = np.random.default_rng(seed)
    data, hinge = mujoco.MjData(model), model.joint("hinge").qposadr[0]
    rows = np.empty((len(angles) * samples, compat.state_size(model, spec)))
    for i, row in enumerate(rows):
        mujoco.mj_resetData(model, data)
        data.qpos[:] += POSITION_SD * rng.standard_normal(model.nq)
        data.qvel[:] += VELOCITY_SD * rng.standard_normal(model.nv)
        data.qpos[hinge] += angles[i // samples]
        compat.get_state(model, data, row, spec)
    return rows


def ask(
    angles: Sequence[float] = ANGLES,
    samples: int = 1000,
    threads: Sequence[int] = (1, 4, 16),
    seed: int = 0,
    clock: Callable[[], float] = time.perf_counter,
) -> Result:
    """Count the falls by every way there is here.

    Raises:
      InputError: no angle, or no sample.
      MachineError: two ways count differently.
    """
    if not angles or samples < 1:
        raise InputError("give at least one angle and one sample")
    model = models.load(models.resolve("cartpole"))
    initial = starts(model, angles, samples, seed)
    nstep = round(WITHIN_S / model.opt.timestep)
    ways = []
    for name, count, run in _ways(model, initial, nstep, threads):
        run()  # threads are started, memory is touched
        begin = clock()
        fallen = run()
        seconds = clock() - begin
        counts = tuple(int(n) for n in fallen.reshape(len(angles), samples).sum(axis=1))
        ways.append(Way(name, counts, seconds, count))
        if counts != ways[0].counts:
            raise MachineError(f"{name} counts {counts}, the loop {ways[0].counts}")
    return Result(tuple(angles), samples, tuple(ways))


def _ways(
    model: Any, initial: np.ndarray, nstep: int, threads: Sequence[int]
) -> list[tuple[str, int, Callable[[], np.ndarray]]]:
    """Return (name, threads, a function that tells which simulations fell) of each way."""
    hinge = int(model.joint("hinge").qposadr[0])
    found = [("python_loop", 1, _loop(model, initial, nstep, hinge))]
    if compat.rollout_unavailable() is None:
        counts = threads if compat.rollout_threads() else [1]
        found += [
            (f"rollout, {n} threads", n, _rollout(model, initial, nstep, hinge, n)) for n in counts
        ]
    if compat.batch_unavailable() is None:
        found += [
            (f"Batch, {n} threads", n, _batch(model, initial, nstep, hinge, n)) for n in threads
        ]
    return found


def _loop(model: Any, initial: np.ndarray, nstep: int, hinge: int) -> Callable[[], np.ndarray]:
    data, spec = mujoco.MjData(model), compat.state_spec("INTEGRATION")
    qpos, mj_step = data.qpos, mujoco.mj_step

    def run() -> np.ndarray:
        fallen = np.zeros(len(initial), dtype=bool)
        for i, row in enumerate(initial):
            mujoco.mj_resetData(model, data)
            mujoco.mj_setState(model, data, row, spec)
            for _ in range(nstep):
                mj_step(model, data)
                fallen[i] |= abs(qpos[hinge]) > FALLEN_RAD
        return fallen

    return run


def _rollout(
    model: Any, initial: np.ndarray, nstep: int, hinge: int, threads: int
) -> Callable[[], np.ndarray]:
    from mujoco import rollout

    whole = compat.state_columns(model, compat.state_spec("INTEGRATION"))
    physics = compat.state_columns(model, compat.state_spec("FULLPHYSICS"))
    kept = np.concatenate([np.arange(whole[f].start, whole[f].stop) for f in physics])
    start, column = np.ascontiguousarray(initial[:, kept]), physics["qpos"].start + hinge
    datas = [mujoco.MjData(model) for _ in range(threads)]
    if compat.rollout_threads():
        call = rollout.Rollout(nthread=threads if threads > 1 else 0).rollout
    else:
        call, datas = rollout.rollout, datas[0]
    return lambda: _passed(call(model, datas, start, nstep=nstep)[0][:, :, column])


def _batch(
    model: Any, initial: np.ndarray, nstep: int, hinge: int, threads: int
) -> Callable[[], np.ndarray]:
    from mujoco import batch

    made = batch.Batch(model, len(initial), threads)
    out = {"qpos": np.empty((len(initial), nstep, model.nq))}

    def run() -> np.ndarray:
        made.state[:] = initial
        made.rollout(nstep, None, record=("qpos",), out=out)
        return _passed(out["qpos"][:, :, hinge])

    return run


def _passed(angles: np.ndarray) -> np.ndarray:
    """Return which simulations, of (nbatch, nstep) angles, passed the limit at any step."""
    return np.asarray((np.abs(angles) > FALLEN_RAD).any(axis=1))


def as_result(found: Result) -> dict[str, Any]:
    """Return what `mjbench falls --json` gives."""
    return {
        "samples": found.samples,
        "angles": [
            {"angle": angle, "falls": count, "probability": share, "low": low, "high": high}
            for angle, count, (share, low, high) in zip(
                found.angles, found.ways[0].counts, found.intervals(), strict=True
            )
        ],
        "ways": [
            {
                "path": way.name,
                "threads": way.threads,
                "seconds": way.seconds,
                "speedup": found.ways[0].seconds / way.seconds,
                "counts": list(way.counts),
            }
            for way in found.ways
        ],
    }
