"""How likely the cart-pole falls from each initial angle, computed by every path: `mjbench falls`.

The pole starts at an angle, with small random offsets and velocities, and moves without control.
It has fallen when the hinge passes 0.5 rad within a second. Every path must count the same falls;
only then are their times compared.
"""

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist

import mujoco
import numpy as np

from mjbench.errors import InputError, MachineError, one_line
from mjbench.instrument import machine
from mjbench.loop import pole_paths
from mjbench.simulation import compat, models

WITHIN_S = 1.0
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
      InputError: no angle, one that is not finite, no sample, or more than fit into memory.
      MachineError: two paths count differently, or threads cannot be started.
    """
    if not angles_rad or not np.isfinite(angles_rad).all() or samples < 1:
        raise InputError("give at least one sample and one angle, and finite angles alone")
    model = models.load(models.resolve("cartpole"))
    nstep = round(WITHIN_S / model.opt.timestep)
    _check_memory(model, len(angles_rad) * samples, nstep, max(threads))
    simulations = pole_paths.Simulations(
        model,
        _starts(model, angles_rad, samples, seed),
        nstep=nstep,
        hinge=int(model.joint("hinge").qposadr[0]),
    )
    try:
        counters = pole_paths.fall_counters(simulations, threads)
    except (RuntimeError, MemoryError) as error:  # the system starts no further thread
        raise MachineError(
            f"cannot prepare {max(threads)} threads: {one_line(error)}; reduce --threads"
        ) from error
    paths: list[PathFalls] = []
    for counter in counters:
        paths.append(_path_falls(counter, samples, paths[0] if paths else None))
    angles = zip(angles_rad, paths[0].counts, strict=True)
    return FallExperiment(
        samples,
        tuple(_angle_falls(angle, count, samples) for angle, count in angles),
        tuple(paths),
    )


def _check_memory(model: mujoco.MjModel, nbatch: int, nstep: int, threads: int) -> None:
    """Refuse more simulations than the outputs of all paths have memory for.

    Raises:
      InputError: they have not.
    """
    nstate = compat.state_size(model, compat.state_spec("INTEGRATION"))
    nphysics = compat.state_size(model, compat.state_spec("FULLPHYSICS"))
    # start states, also as rollout and Batch take them; what both return of every step
    per_simulation = 3 * nstate + nstep * (nphysics + model.nsensordata + model.nq)
    bytes_needed = 8 * nbatch * per_simulation + threads * machine.data_bytes(model)
    machine.check_memory(bytes_needed, f"{nbatch} simulations", "reduce --samples or --angles")


def _path_falls(counter: pole_paths.FallCounter, samples: int, loop: PathFalls | None) -> PathFalls:
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
