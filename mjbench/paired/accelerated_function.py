"""A model's steps by a path that compiles, as a function for `timed_function`.

This module runs in the environment of any release, with the packages of the path beside it.
"""

import os
import pickle
from collections.abc import Sequence
from dataclasses import replace
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
from mjbench.simulation import models
from mjbench.simulation.models import ModelSource
from mjbench.simulation.workload import Workload, restore

# JAX reports it for each program that it asks its compiler for, found in the cache or not.
_COMPILE_EVENT = "/jax/core/compile/backend_compile_duration"
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
      cache: folder of compiled programs, which processes of one environment share.
    """
    path, workload = _loaded(source, path_name, workload_file)
    path.use_cache(cache)
    stored = {*cache.rglob("*")}
    compiled, took = _compiled(path, workload, Resources(workload), _requests(path))
    took = replace(took, is_cached=stored == {*cache.rglob("*")})
    return PreparedCall(compiled.clear, compiled.run, lambda: _result(compiled), lambda: took)


def compilation(source: ModelSource, path_name: str, workload_file: Path) -> PreparedCall:
    """Return a function that traces and compiles what `compiled_step` runs, without any cache.

    Its result is that of `compiled_step`, too. MuJoCo Warp compiles once in a process, so only its
    first call is such.
    """
    path, workload = _loaded(source, path_name, workload_file)
    resources, requests = Resources(workload), _requests(path)
    last = list[tuple[Compiled, Compilation]]()
    reference_peaks(workload, resources)  # by which buffers are sized

    def prepare() -> None:
        last.clear()
        requests.clear()
        if "jax" in path.packages:
            import jax

            jax.clear_caches()

    return PreparedCall(
        prepare,
        lambda: last.append(_compiled(path, workload, resources, requests)),
        lambda: _result(last[0][0]),
        lambda: last[0][1],
    )


def _requests(path: AcceleratedPath) -> list[str]:
    """Return a list that grows with what JAX asks its compiler for; empty of other engines."""
    requests = list[str]()
    if "jax" in path.packages:
        import jax

        def note(event: str, *_: object, **__: object) -> None:
            requests.extend([event] if event == _COMPILE_EVENT else [])

        jax.monitoring.register_event_duration_secs_listener(note)
    return requests


def _compiled(
    path: AcceleratedPath, workload: Workload, resources: Resources, requests: Sequence[str]
) -> tuple[Compiled, Compilation]:
    compiled = path.prepare(workload, {}, resources)
    took = compiled.trace_s, compiled.compile_s, compiled.block_s()
    return compiled, Compilation(*took, len(requests) or None)


def _loaded(source: ModelSource, path_name: str, file: Path) -> tuple[AcceleratedPath, Workload]:
    path = accelerated_path(path_name)
    for name, value in path.environment().items():
        if value is None:
            os.environ.pop(name, None)
        else:
            os.environ[name] = value
    workload = restore(models.load(source), pickle.loads(file.read_bytes()))
    if reason := path.cannot_run(workload, {}):
        raise UnavailableError(reason)
    return path, workload


def _result(compiled: Compiled) -> dict[str, np.ndarray]:
    """Check where the last run ended; return what `compiled_step` says."""
    workload = compiled.workload
    if lost := compiled.lost():
        raise MachineError(f"{lost} of {workload.nbatch} simulations do not end in finite numbers")
    after = compiled.advance(start_fields(workload), workload.control, 1).fields
    return {name: after[name].astype(np.float32) for name in _COMPARED}
