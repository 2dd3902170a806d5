"""A model's steps by a path that compiles, as a function for `timed_function`.

This module runs in the environment of any release, with the packages of the path beside it.
"""

import os
import pickle
import time
from pathlib import Path

import numpy as np

from mjbench.errors import MachineError, UnavailableError
from mjbench.measuring.calls import Compilation, PreparedCall
from mjbench.paths.accelerated import (
    AcceleratedPath,
    Compiled,
    accelerated_path,
    reference_peaks,
    start_fields,
)
from mjbench.paths.base import Resources
from mjbench.paths.warp import CACHE_VARIABLE
from mjbench.simulation import models
from mjbench.simulation.models import ModelSource
from mjbench.simulation.workload import Workload, restore

# Of JAX's cache of compiled programs, so that it has every program.
_CACHES_ALL = {
    "jax_enable_compilation_cache": True,
    "jax_persistent_cache_min_compile_time_secs": 0.0,
    "jax_persistent_cache_min_entry_size_bytes": -1,
}
# JAX reports it for each program that it asks its compiler for, found in the cache or not.
_COMPILED = "/jax/core/compile/backend_compile_duration"
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
    path = _available(path_name)
    _use_cache(path, cache)
    workload = _workload(path, source, workload_file)
    programs, stored = _Programs(path), {*cache.rglob("*")}
    compiled = path.prepare(workload, {}, Resources(workload))
    is_cached = stored == {*cache.rglob("*")}
    compilation = programs.compilation(compiled, _run_s(compiled), is_cached)
    return PreparedCall(
        compiled.clear, compiled.run, lambda: _result(compiled, workload), lambda: compilation
    )


def compilation(source: ModelSource, path_name: str, workload_file: Path) -> PreparedCall:
    """Return a function that traces and compiles what `compiled_step` runs, without any cache.

    Its result is that of `compiled_step`, too. MuJoCo Warp compiles once in a process, so only its
    first call is such.

    Raises:
      UnavailableError: as `compiled_step`.
    """
    path = _available(path_name)
    fresh = _FreshCompilation(path, _workload(path, source, workload_file))
    return PreparedCall(fresh.prepare, fresh.compile, fresh.result, fresh.compilation)


class _FreshCompilation:
    """Compiles a path's program as if it were the first time."""

    def __init__(self, path: AcceleratedPath, workload: Workload):
        self._path, self._workload = path, workload
        self._resources, self._programs = Resources(workload), _Programs(path)
        self._compiled: Compiled | None = None
        self._first_run_s = 0.0
        reference_peaks(workload, self._resources)  # by which buffers are sized

    def prepare(self) -> None:
        self._compiled = None
        self._programs.forget()

    def compile(self) -> None:
        self._compiled = self._path.prepare(self._workload, {}, self._resources)

    def result(self) -> dict[str, np.ndarray]:
        assert self._compiled is not None, "it was compiled"
        self._first_run_s = _run_s(self._compiled)
        return _result(self._compiled, self._workload)

    def compilation(self) -> Compilation:
        assert self._compiled is not None, "it was compiled"
        return self._programs.compilation(self._compiled, self._first_run_s)


class _Programs:
    """Counts the programs that JAX asks its compiler for, from now on."""

    def __init__(self, path: AcceleratedPath):
        self._has_jax = "jax" in path.packages
        self._events: list[str] = []
        if self._has_jax:
            import jax

            jax.monitoring.register_event_duration_secs_listener(
                lambda event, *_, **__: self._events.append(event)
            )

    def forget(self) -> None:
        """Have JAX compile everything anew; count from 0 again."""
        self._events.clear()
        if self._has_jax:
            import jax

            jax.clear_caches()

    def compilation(
        self, compiled: Compiled, first_run_s: float, is_cached: bool = False
    ) -> Compilation:
        """Return what a program took so far."""
        programs = self._events.count(_COMPILED) if self._has_jax else None
        return Compilation(compiled.trace_s, compiled.compile_s, first_run_s, programs, is_cached)


def _run_s(compiled: Compiled) -> float:
    compiled.clear()
    begin_s = time.perf_counter()
    compiled.run()
    return time.perf_counter() - begin_s


def _available(path_name: str) -> AcceleratedPath:
    """Return a path, with the environment that it needs in this process."""
    path = accelerated_path(path_name)
    if reason := path.unavailable():
        raise UnavailableError(reason)
    for name, value in path.environment().items():
        if value is None:
            os.environ.pop(name, None)
        else:
            os.environ[name] = value
    return path


def _workload(path: AcceleratedPath, source: ModelSource, file: Path) -> Workload:
    workload = restore(models.load(source), pickle.loads(file.read_bytes()))
    if reason := path.unsuited(workload, {}):
        raise UnavailableError(reason)
    return workload


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


def _use_cache(path: AcceleratedPath, folder: Path) -> None:
    """Have what a path compiles stored in a folder, and read from it."""
    if "warp" in path.packages:
        os.environ[CACHE_VARIABLE] = str(folder)
    if "jax" not in path.packages:
        return
    import jax

    jax.config.update("jax_compilation_cache_dir", str(folder))
    for name, value in _CACHES_ALL.items():
        jax.config.update(name, value)
