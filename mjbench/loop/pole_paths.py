"""The paths by which `mjbench falls` counts, each a function that steps every simulation."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from mjbench.simulation import compat

# The pole has fallen when it passes this angle.
FALLEN_RAD = 0.5


@dataclass(frozen=True, eq=False)
class Simulations:
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
class FallCounter:
    """One path.

    Attributes:
      path: its name, with its threads.
      threads: that it uses.
      has_fallen: steps all simulations; returns (nbatch,) whether the pole fell in each.
    """

    path: str
    threads: int
    has_fallen: Callable[[], np.ndarray]


def fall_counters(simulations: Simulations, threads: Sequence[int]) -> list[FallCounter]:
    """Return every path that this MuJoCo has; the Python loop first.

    Paths take turns, so those of one kind share the arrays that they write to.
    """
    model, nbatch, nstep = simulations.model, len(simulations.initial), simulations.nstep
    counters = [FallCounter("python_loop", 1, _loop(simulations))]
    if compat.rollout_unavailable() is None:
        nphysics = compat.state_size(model, compat.state_spec("FULLPHYSICS"))
        state = np.empty((nbatch, nstep, nphysics))
        sensordata = np.empty((nbatch, nstep, model.nsensordata))
        counters += [
            FallCounter(f"rollout, {n} threads", n, _rollout(simulations, n, state, sensordata))
            for n in (threads if compat.rollout_threads() else [1])
        ]
    if compat.batch_unavailable() is None:
        qpos = np.empty((nbatch, nstep, model.nq))
        counters += [
            FallCounter(f"Batch, {n} threads", n, _batch(simulations, n, qpos)) for n in threads
        ]
    return counters


def _loop(simulations: Simulations) -> Callable[[], np.ndarray]:
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


def _rollout(
    simulations: Simulations, threads: int, state: np.ndarray, sensordata: np.ndarray
) -> Callable[[], np.ndarray]:
    """Return what counts by `mujoco.rollout`; it writes to `state` and `sensordata`."""
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

    def has_fallen() -> np.ndarray:
        call(model, datas, start, nstep=nstep, state=state, sensordata=sensordata)
        return _passed_limit(state[:, :, hinge_column])

    return has_fallen


def _batch(simulations: Simulations, threads: int, qpos: np.ndarray) -> Callable[[], np.ndarray]:
    """Return what counts by `mujoco.batch`; it writes to `qpos`."""
    from mujoco import batch

    model, initial = simulations.model, simulations.initial
    stepper = batch.Batch(model, len(initial), threads)

    def has_fallen() -> np.ndarray:
        stepper.state[:] = initial
        stepper.rollout(simulations.nstep, None, record=("qpos",), out={"qpos": qpos})
        return _passed_limit(qpos[:, :, simulations.hinge])

    return has_fallen


def _passed_limit(angles_rad: np.ndarray) -> np.ndarray:
    """Return (nbatch,) whether (nbatch, nstep) angles passed the limit at any step."""
    return np.asarray((np.abs(angles_rad) > FALLEN_RAD).any(axis=1))
