"""How likely the cart-pole falls from each initial angle, computed by every path: `mjbench falls`.

The pole starts at an angle, with small random offsets and velocities, and moves without control.
It has fallen when the hinge passes 0.5 rad within a second. Every path must count the same falls;
only then are their times compared.
"""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from statistics import NormalDist

import mujoco
import numpy as np

from mjbench.errors import InputError, MachineError
from mjbench.simulation import compat, models

FALLEN_RAD, WITHIN_S = 0.5, 1.0
# Standard deviations of the random starts: positions in m and rad, velocities per second.
POSITION_SD, VELOCITY_SD = 0.02, 0.2
ANGLES_RAD = tuple(round(0.05 * i, 2) for i in range(9))
CONFIDENCE = 0.95


@dataclass(frozen=True)
class AngleFalls:
    """The falls from one initial angle.

    Attributes:
      angle: of the pole at the start, in rad.
      falls: simulations in which it fell.
      probability: share of the simulations in which it fell.
      low: lower end of the probability's interval.
      high: upper end of the probability's interval.
    """

    angle: float
    falls: int
    probability: float
    low: float
    high: float


@dataclass(frozen=True)
class PathFalls:
    """The falls that one path counted, and the time it took.

    Attributes:
      path: its name, with its threads.
      threads: that it used.
      seconds: of stepping, with everything prepared.
      speedup: over the Python loop.
      counts: falls at each angle.
    """

    path: str
    threads: int
    seconds: float
    speedup: float
    counts: tuple[int, ...]


@dataclass(frozen=True)
class FallExperiment:
    """Falls of the cart-pole.

    Attributes:
      samples: starts for each angle.
      angles: the falls from each initial angle.
      paths: what each path counted; the Python loop first.
    """

    samples: int
    angles: tuple[AngleFalls, ...]
    paths: tuple[PathFalls, ...]


@dataclass(frozen=True)
class Proportion:
    """A proportion with its interval."""

    share: float
    low: float
    high: float


def wilson(successes: int, trials: int) -> Proportion:
    """Return a proportion with its score interval (Wilson, JASA 22, 1927) at CONFIDENCE.

    Raises:
      ValueError: no trials, or successes outside 0 to trials.
    """
    if not 0 <= successes <= trials or trials < 1:
        raise ValueError(f"not a proportion: {successes} of {trials}")
    z = NormalDist().inv_cdf((1 + CONFIDENCE) / 2)
    share, growth = successes / trials, 1 + z * z / trials
    centre = (share + z * z / (2 * trials)) / growth
    half = z / growth * math.sqrt(share * (1 - share) / trials + z * z / (4 * trials**2))
    return Proportion(share, max(0.0, centre - half), min(1.0, centre + half))


def measure(
    angles_rad: Sequence[float] = ANGLES_RAD,
    samples: int = 1000,
    threads: Sequence[int] = (1, 4, 16),
    seed: int = 0,
) -> FallExperiment:
    """Count the falls by every path that this MuJoCo has, and time it.

    Args:
      angles_rad: initial angles.
      samples: starts for each angle.
      threads: numbers of threads for the paths that have any.
      seed: of the random starts.

    Raises:
      InputError: no angle, or no sample.
      MachineError: two paths count differently.
    """
    if not angles_rad or samples < 1:
        raise InputError("give at least one angle and one sample")
    model = models.load(models.resolve("cartpole"))
    simulations = _Simulations(
        model,
        _starts(model, angles_rad, samples, seed),
        nstep=round(WITHIN_S / model.opt.timestep),
        hinge=int(model.joint("hinge").qposadr[0]),
    )
    paths: list[PathFalls] = []
    for counter in _counters(simulations, threads):
        paths.append(_path_falls(counter, samples, paths[0] if paths else None))
    angles = zip(angles_rad, paths[0].counts, strict=True)
    return FallExperiment(
        samples,
        tuple(_angle_falls(angle, count, samples) for angle, count in angles),
        tuple(paths),
    )


def _path_falls(counter: "_Counter", samples: int, loop: PathFalls | None) -> PathFalls:
    """Count the falls by one path, and time it.

    Args:
      counter: the path.
      samples: starts for each angle.
      loop: what the Python loop counted; None for the Python loop itself.

    Raises:
      MachineError: it counts differently.
    """
    counter.has_fallen()  # starts threads, touches all memory
    begin = time.perf_counter()
    fallen = counter.has_fallen()
    seconds = time.perf_counter() - begin
    counts = tuple(int(n) for n in fallen.reshape(-1, samples).sum(axis=1))
    if loop and counts != loop.counts:
        raise MachineError(f"{counter.path} counts {counts} falls, the Python loop {loop.counts}")
    speedup = loop.seconds / seconds if loop else 1.0
    return PathFalls(counter.path, counter.threads, seconds, speedup, counts)


def _angle_falls(angle_rad: float, falls: int, samples: int) -> AngleFalls:
    probability = wilson(falls, samples)
    return AngleFalls(angle_rad, falls, probability.share, probability.low, probability.high)


def _starts(
    model: mujoco.MjModel, angles_rad: Sequence[float], samples: int, seed: int
) -> np.ndarray:
    """Return (len(angles_rad) * samples, nstate) rows of mjSTATE_INTEGRATION, angle by angle."""
    spec = compat.state_spec("INTEGRATION")
    rng = np.random.default_rng(seed)
    data, hinge = mujoco.MjData(model), model.joint("hinge").qposadr[0]
    rows = np.empty((len(angles_rad) * samples, compat.state_size(model, spec)))
    for i, row in enumerate(rows):
        mujoco.mj_resetData(model, data)
        data.qpos[:] += POSITION_SD * rng.standard_normal(model.nq)
        data.qvel[:] += VELOCITY_SD * rng.standard_normal(model.nv)
        data.qpos[hinge] += angles_rad[i // samples]
        compat.get_state(model, data, row, spec)
    return rows


@dataclass(frozen=True, eq=False)
class _Simulations:
    """What every path steps.

    Attributes:
      model: the cart-pole.
      initial: (nbatch, nstate) rows of mjSTATE_INTEGRATION.
      nstep: steps of each.
      hinge: index in qpos of the pole's angle.
    """

    model: mujoco.MjModel
    initial: np.ndarray
    nstep: int
    hinge: int


@dataclass(frozen=True)
class _Counter:
    """One path.

    Attributes:
      path: its name, with its threads.
      threads: that it uses.
      has_fallen: steps all simulations; returns (nbatch,) whether the pole fell in each.
    """

    path: str
    threads: int
    has_fallen: Callable[[], np.ndarray]


def _counters(simulations: _Simulations, threads: Sequence[int]) -> list[_Counter]:
    """Return every path that this MuJoCo has; the Python loop first."""
    counters = [_Counter("python_loop", 1, _loop(simulations))]
    if compat.rollout_unavailable() is None:
        counters += [
            _Counter(f"rollout, {n} threads", n, _rollout(simulations, n))
            for n in (threads if compat.rollout_threads() else [1])
        ]
    if compat.batch_unavailable() is None:
        counters += [_Counter(f"Batch, {n} threads", n, _batch(simulations, n)) for n in threads]
    return counters


def _loop(simulations: _Simulations) -> Callable[[], np.ndarray]:
    model, initial, nstep = simulations.model, simulations.initial, simulations.nstep
    data, spec = mujoco.MjData(model), compat.state_spec("INTEGRATION")
    qpos, hinge, mj_step = data.qpos, simulations.hinge, mujoco.mj_step

    def has_fallen() -> np.ndarray:
        fallen = np.zeros(len(initial), dtype=bool)
        for i, row in enumerate(initial):
            mujoco.mj_resetData(model, data)
            mujoco.mj_setState(model, data, row, spec)
            for _ in range(nstep):
                mj_step(model, data)
                fallen[i] |= abs(qpos[hinge]) > FALLEN_RAD
        return fallen

    return has_fallen


def _rollout(simulations: _Simulations, threads: int) -> Callable[[], np.ndarray]:
    from mujoco import rollout

    model, nstep = simulations.model, simulations.nstep
    start = np.ascontiguousarray(simulations.initial[:, compat.physics_entries(model)])
    physics = compat.state_columns(model, compat.state_spec("FULLPHYSICS"))
    hinge_column = physics["qpos"].start + simulations.hinge
    datas = [mujoco.MjData(model) for _ in range(threads)]
    if compat.rollout_threads():
        call = rollout.Rollout(nthread=threads if threads > 1 else 0).rollout
    else:
        call, datas = rollout.rollout, datas[0]
    state = np.empty((len(start), nstep, start.shape[1]))
    sensordata = np.empty((len(start), nstep, model.nsensordata))

    def has_fallen() -> np.ndarray:
        call(model, datas, start, nstep=nstep, state=state, sensordata=sensordata)
        return _passed_limit(state[:, :, hinge_column])

    return has_fallen


def _batch(simulations: _Simulations, threads: int) -> Callable[[], np.ndarray]:
    from mujoco import batch

    model, initial = simulations.model, simulations.initial
    stepper = batch.Batch(model, len(initial), threads)
    out = {"qpos": np.empty((len(initial), simulations.nstep, model.nq))}

    def has_fallen() -> np.ndarray:
        stepper.state[:] = initial
        stepper.rollout(simulations.nstep, None, record=("qpos",), out=out)
        return _passed_limit(out["qpos"][:, :, simulations.hinge])

    return has_fallen


def _passed_limit(angles_rad: np.ndarray) -> np.ndarray:
    """Return (nbatch,) whether (nbatch, nstep) angles passed the limit at any step."""
    return np.asarray((np.abs(angles_rad) > FALLEN_RAD).any(axis=1))
