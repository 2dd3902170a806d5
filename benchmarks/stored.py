"""Start states and controls, computed once by one release and stored for all of them.

    python -m benchmarks.stored

writes stored.npz with the release installed here (the one of constraints.txt): for each model of
models/ its start state by MjData field, its controls, and, for the physics drift, some states
along the way with the result of one step from each. A release that computed its own start would
do other work. Do it again when a model was changed or added, and raise the `version` of the
benchmarks that the change concerns: their earlier figures are of other work.
"""

import functools
import hashlib
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from mjbench import paths
from mjbench.releases import catalogue
from mjbench.simulation import agreement, models, work, workload

FILE = Path(__file__).with_name("stored.npz")
# Simulations and steps of each; every control is held for ten steps.
NBATCH, NSTEP, HOLD = 10, 100, 10
# Models whose step takes most of a millisecond do a tenth of the steps.
HEAVY = ("cloth", "pile")
HEAVY_NSTEP = 10
# Steps before the states from which the drift of one step is taken.
DRIFT_AFTER = (0, 3, 6, 9)
# The first release that can load a model; the others load in all (models/README.md).
SINCE = {"cloth": "3.0.0", "quadruped_terrain": "3.1.2"}


def light() -> list[str]:
    """Return the names of the models that do 10 simulations of 100 steps."""
    return [name for name in models.shipped() if name not in HEAVY]


def load(name: str) -> Any:
    """Return one of our models as MjModel.

    Raises:
      NotImplementedError: this release lacks what the model needs.
    """
    since = SINCE.get(name)
    if since and catalogue.key(mujoco.__version__) < catalogue.key(since):
        raise NotImplementedError(f"{name} needs MuJoCo {since}")
    return models.load(models.resolve(name))


def stored_workload(name: str, nbatch: int = NBATCH, nstep: int = NSTEP) -> workload.Workload:
    """Return the stored workload of a model, its simulations repeated in turn up to nbatch."""
    model = load(name)
    control = _read(f"{name}/control")
    rows = np.arange(nbatch) % len(control)
    control = np.ascontiguousarray(control[rows, : max(1, nstep // HOLD)])
    start = workload.states(model, {k: v[:1] for k, v in _fields(name, "before").items()})
    return workload.Workload(
        model, np.tile(start, (nbatch, 1)), control, hold=min(HOLD, nstep), seed=0
    )


def drift(name: str) -> float:
    """Return how far one step leads from the reference release's result, at the most."""
    model = load(name)
    after = work.one_step(model, workload.states(model, _fields(name, "before")))
    return agreement.drift(after, _fields(name, "after"))


@functools.cache
def prepared(path: str, workload_of: tuple[Any, ...], **options: Any) -> paths.Prepared:
    """Return a path's run of a stored workload, after checking it against the reference run.

    asv calls `setup` before every sample; this is made once in a process.

    Args:
      path: the path's name.
      workload_of: arguments of `stored_workload`.
      options: the path's options.

    Raises:
      NotImplementedError: the release or the machine lacks what the path needs.
      RuntimeError: the path's final states are not those of the reference run.
    """
    way = paths.find(path)
    options = way.complete(options)
    reason = way.unavailable()
    if reason:
        raise NotImplementedError(reason)
    made = stored_workload(*workload_of)
    reason = way.unsuited(made, options)
    if reason:
        raise NotImplementedError(reason)
    run = way.prepare(made, options, paths.Resources(made))
    if not np.array_equal(run.verified_states().values, work.observe(made).final_state):
        raise RuntimeError(f"not timed: {path} {options} disagrees with the plain loop")
    return run


def _fields(name: str, when: str) -> dict[str, np.ndarray]:
    prefix = f"{name}/{when}/"
    return {key.removeprefix(prefix): _read(key) for key in _keys() if key.startswith(prefix)}


@functools.cache
def _keys() -> tuple[str, ...]:
    with np.load(FILE) as stored:
        return tuple(stored.files)


@functools.cache
def _read(key: str) -> np.ndarray:
    with np.load(FILE) as stored:
        return np.array(stored[key])


def mjcf_digest(name: str) -> str:
    """Return 16 hexadecimal digits of a model's file."""
    content = models.resolve(name).path.read_bytes()
    return hashlib.blake2b(content, digest_size=8).hexdigest()


def stored_digest(name: str) -> str:
    """Return the digest of the model file that the stored states were computed with."""
    return str(_read(f"{name}/mjcf"))


def compute(name: str) -> dict[str, np.ndarray]:
    """Return what is stored of a model, by key, computed by the release at hand."""
    model = load(name)
    nstep = HEAVY_NSTEP if name in HEAVY else NSTEP
    made = workload.make(model, NBATCH, nstep, HOLD)
    stride = max(1, nstep // HEAVY_NSTEP)
    one = made.only(np.arange(NBATCH) < 1)
    before = np.concatenate(
        [one.initial_state, *(_after(one, n * stride) for n in DRIFT_AFTER[1:])]
    )
    entries = {"control": made.control, "mjcf": np.array(mjcf_digest(name))}
    entries |= {f"before/{k}": v for k, v in workload.fields(model, before).items()}
    entries |= {f"after/{k}": v for k, v in work.one_step(model, before).items()}
    return {f"{name}/{key}": value for key, value in entries.items()}


def _after(one: workload.Workload, nstep: int) -> np.ndarray:
    """Return the state of a one-simulation workload after `nstep` steps."""
    control = one.step_control[:, :nstep]
    return work.observe(workload.Workload(one.model, one.initial_state, control, 1, 0)).final_state


def main() -> None:
    """Write stored.npz."""
    entries = {"release": np.array(mujoco.__version__)}
    for name in models.shipped():
        entries |= compute(name)
    np.savez_compressed(FILE, **entries)  # type: ignore[arg-type]


if __name__ == "__main__":
    main()
