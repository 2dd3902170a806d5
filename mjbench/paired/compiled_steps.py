"""A model's steps by a path that compiles, as a function for `timed_function`.

This module runs in the environment of any release, with the packages of the path beside it.
"""

import os
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from mjbench.errors import UnavailableError
from mjbench.paths.accelerated import Compiled, accelerated_path, start_fields
from mjbench.paths.base import Resources
from mjbench.simulation import models
from mjbench.simulation.models import ModelSource
from mjbench.simulation.workload import restore

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
) -> Callable[[], Any]:
    """Return a function that does the run of a workload by a path that compiles.

    It returns the positions and velocities, (nbatch, size), one step after the start states: along
    a run, contacts multiply rounding.

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
    start = start_fields(workload)
    after = compiled.advance(start, workload.control, 1).fields
    results = {name: after[name].astype(np.float32) for name in _COMPARED}
    compiled.reload()
    return lambda: _run(compiled, results)


def _run(compiled: Compiled, results: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    compiled.clear()
    compiled.run()
    return results


def _use_cache(folder: Path) -> None:
    import jax

    jax.config.update("jax_compilation_cache_dir", str(folder))
    for name, value in _CACHES_ALL.items():
        jax.config.update(name, value)
