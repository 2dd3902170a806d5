"""Start states and controls that are the same for every release: computed once, and stored.

    python -m benchmarks.stored

writes stored.npz with the installed release, which must be that of constraints.txt. It holds, for
each model of models/, the start state by MjData field, the controls, and, for `step.Drift`, some
states along the way with the result of one step from each. Releases that computed their own start
states would do different work.

Run it again when a model was changed or added, and raise the `version` of the benchmarks that use
the model: their earlier results are of other work.
"""

import functools
import hashlib
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from mjbench import paths
from mjbench.releases.release import version_key
from mjbench.simulation import agreement, models, reference_run, workload

FILE = Path(__file__).with_name("stored.npz")
# Simulations, steps of each, and steps for which each control is held.
NBATCH, NSTEP, HOLD = 10, 100, 10
# Models whose step takes about a millisecond; they do a tenth of the steps.
HEAVY = ("cloth", "pile")
HEAVY_NSTEP = 10
# The drift of one step is measured from the start state, and after these tenths of the run.
DRIFT_AFTER = (0, 3, 6, 9)
# The first release that can load a model; all releases load the others (models/README.md).
SINCE = {"cloth": "3.0.0", "quadruped_terrain": "3.1.2"}


def light() -> list[str]:
    """Return the names of our models that are not heavy."""
    return [name for name in models.shipped() if name not in HEAVY]


def nstep_of(name: str) -> int:
    """Return the steps per simulation of a model's benchmarks."""
    return HEAVY_NSTEP if name in HEAVY else NSTEP


def load(name: str) -> mujoco.MjModel:
    """Return one of our models.

    Raises:
      NotImplementedError: this release lacks what the model needs.
    """
    since = SINCE.get(name)
    if since and version_key(mujoco.__version__) < version_key(since):
        raise NotImplementedError(f"{name} needs MuJoCo {since}")
    return models.load(models.resolve(name))


def stored_workload(name: str, nbatch: int = NBATCH, nstep: int = NSTEP) -> workload.Workload:
    """Return the stored workload of a model.

    All simulations have the stored start state; they differ in their controls.

    Args:
      nbatch: simulations; those beyond the stored ones repeat them in order.
      nstep: steps per simulation, at most the stored ones.

    Raises:
      NotImplementedError: this release lacks what the model needs.
    """
    model = load(name)
    stored_control = _read(f"{name}/control")
    rows = np.arange(nbatch) % len(stored_control)
    control = np.ascontiguousarray(stored_control[rows, : max(1, nstep // HOLD)])
    start_fields = {field: values[:1] for field, values in _fields(name, "before").items()}
    start = workload.states(model, start_fields)
    return workload.Workload(
        model, np.tile(start, (nbatch, 1)), control, hold=min(HOLD, nstep), seed=0
    )


def drift(name: str) -> float:
    """Return the largest difference of one step's result from the stored one, in SI units."""
    model = load(name)
    after = _after_one_step(model, workload.states(model, _fields(name, "before")))
    return agreement.drift(after, _fields(name, "after"))


def _after_one_step(model: mujoco.MjModel, states: np.ndarray) -> dict[str, np.ndarray]:
    """Return qpos, qvel and act, each (n, size), one step after each of (n, nstate) states."""
    after = workload.fields(model, workload.stepped(model, states))
    return {name: after.get(name, np.empty((len(states), 0))) for name in ("qpos", "qvel", "act")}


@functools.cache
def prepared_run(
    path: str,
    model: str,
    nbatch: int = NBATCH,
    nstep: int = NSTEP,
    returns: workload.Product = workload.Product.FINAL,
    **options: Any,
) -> paths.Prepared:
    """Return a path's run of a stored workload, verified against the reference run.

    asv calls `setup` before every sample; the run is prepared once per process.

    Raises:
      RuntimeError: the path's final states differ from the reference run's.
    """
    stepping_path = paths.find(path)
    options = stepping_path.complete(options)
    reason = stepping_path.unavailable()
    if reason:
        raise NotImplementedError(reason)
    stored = stored_workload(model, nbatch, nstep).returning(returns)
    reason = stepping_path.unsuited(stored, options)
    if reason:
        raise NotImplementedError(reason)
    run = stepping_path.prepare(stored, options, paths.Resources(stored))
    if not np.array_equal(run.verified_states().values, _final_state(model, nbatch, nstep)):
        raise RuntimeError(f"{path} {options} is not timed: it disagrees with the plain loop")
    return run


@functools.cache
def _final_state(model: str, nbatch: int, nstep: int) -> np.ndarray:
    """Return (nbatch, nstate) where the reference run of a stored workload ends."""
    return reference_run.observe(stored_workload(model, nbatch, nstep)).final_state


def _fields(name: str, when: str) -> dict[str, np.ndarray]:
    """Return stored states by MjData field: `before` a step, or `after` it."""
    prefix = f"{name}/{when}/"
    return {key.removeprefix(prefix): _read(key) for key in _keys() if key.startswith(prefix)}


@functools.cache
def _keys() -> tuple[str, ...]:
    with np.load(FILE) as file:
        return tuple(file.files)


@functools.cache
def _read(key: str) -> np.ndarray:
    with np.load(FILE) as file:
        return np.array(file[key])


def stored_release() -> str:
    """Return the release that computed what is stored."""
    return str(_read("release"))


def mjcf_digest(name: str) -> str:
    """Return 16 hexadecimal digits that name the content of a model's file."""
    content = models.resolve(name).path.read_bytes()
    return hashlib.blake2b(content, digest_size=8).hexdigest()


def stored_digest(name: str) -> str:
    """Return the digest of the model file that the stored states were computed with."""
    return str(_read(f"{name}/mjcf"))


def compute(name: str) -> dict[str, np.ndarray]:
    """Return what is stored of a model, by key, computed by the installed release."""
    model, nstep = load(name), nstep_of(name)
    random_workload = workload.make(model, NBATCH, nstep, HOLD)
    single = random_workload.only(np.arange(NBATCH) < 1)
    stride = max(1, nstep // HEAVY_NSTEP)
    later_states = (_state_after(single, count * stride) for count in DRIFT_AFTER[1:])
    before = np.concatenate([single.initial_state, *later_states])
    entries = {"control": random_workload.control, "mjcf": np.array(mjcf_digest(name))}
    entries |= {f"before/{k}": v for k, v in workload.fields(model, before).items()}
    entries |= {f"after/{k}": v for k, v in _after_one_step(model, before).items()}
    return {f"{name}/{key}": value for key, value in entries.items()}


def _state_after(single: workload.Workload, nstep: int) -> np.ndarray:
    """Return the (1, nstate) state of a workload of one simulation after `nstep` steps."""
    control = single.step_control[:, :nstep]
    stopped = workload.Workload(single.model, single.initial_state, control, hold=1, seed=0)
    return reference_run.observe(stopped).final_state


def main() -> None:
    """Write stored.npz."""
    entries = {"release": np.array(mujoco.__version__)}
    for name in models.shipped():
        entries |= compute(name)
    np.savez_compressed(FILE, **entries)  # type: ignore[arg-type]


if __name__ == "__main__":
    main()
