"""A model's steps by a path that compiles, as a function for `timed_function`.

This module runs in the environment of any release, with the packages of the path beside it.
"""

import os
import pickle
from pathlib import Path

import numpy as np

from mjbench.errors import MachineError, UnavailableError
from mjbench.measuring.calls import PreparedCall
from mjbench.paths.accelerated import Compiled, accelerated_path, start_fields
from mjbench.paths.base import Resources
from mjbench.simulation import models
from mjbench.simulation.models import ModelSource
from mjbench.simulation.workload import Workload, restore

# Of JAX's cache of compiled programs, so that it has every program.
_CACHES_ALL = {
    "jax_enable_compilation_cache": True,
    "jax_persistent_cache_min_compile_time_secs": 0.0,
    "jax_persistent_cache_min_entry_size_bytes": -1,
}
# What single steps are compared by.
_COMPARED = ("qpos", "qvel")


def compiled_step(
    source: ModelSource, path_name: str, workload_file: Path, cache: Path
) -> PreparedCall:
    """Return a function that does the run of a workload by a path that compiles.

    Its result is the positions and velocities, (nbatch, size), one step after the start states:
    along a run, contacts multiply rounding. MachineError where the run overflows a buffer, or does
    not end in finite numbers.

    Args:
      workload_file: a pickled `PortableWorkload`.
      cache: folder of compiled programs, which processes of one environment share.

    Raises:
      UnavailableError: a package is missing, or the engine does not take the model.
    """
    path = accelerated_path(path_name)
    if reason := path.unavailable():
        raise UnavailableError(reason)
    for name, value in path.environment().items():
        if value is None:
            os.environ.pop(name, None)
        else:
            os.environ[name] = value
    if "jax" in path.packages:
        _use_cache(cache)
    workload = restore(models.load(source), pickle.loads(workload_file.read_bytes()))
    if reason := path.unsuited(workload, {}):
        raise UnavailableError(reason)
    compiled = path.prepare(workload, {}, Resources(workload))
    return PreparedCall(compiled.clear, compiled.run, lambda: _result(compiled, workload))


def _result(compiled: Compiled, workload: Workload) -> dict[str, np.ndarray]:
    """Check where the last run ended; return what `compiled_step` says."""
    states = compiled.final_states()
    lost = (~np.isfinite(states.values) & (True if states.mask is None else states.mask)).any(1)
    if lost.any():
        raise MachineError(
            f"{lost.sum()} of {workload.nbatch} simulations do not end in finite numbers"
        )
    after = compiled.advance(start_fields(workload), workload.control, 1).fields
    return {name: after[name].astype(np.float32) for name in _COMPARED}


def _use_cache(folder: Path) -> None:
    import jax

    jax.config.update("jax_compilation_cache_dir", str(folder))
    for name, value in _CACHES_ALL.items():
        jax.config.update(name, value)
