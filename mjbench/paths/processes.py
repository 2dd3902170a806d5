"""Worker processes, each with its own MjModel and MjData, started before the timed region.

States and controls are in memory shared with the workers; a run sends each worker one byte and
waits for one byte back. Workers end when the parent does, however it ends.
"""

import contextlib
import multiprocessing
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnContext, SpawnProcess
from typing import Any

import mujoco
import numpy as np

from mjbench.instrument import child
from mjbench.paths.base import (
    Option,
    Options,
    Prepared,
    Resources,
    SteppingPath,
    array_callbacks,
    make_simulate,
)
from mjbench.paths.threads import shares
from mjbench.simulation.workload import Workload

_START_LIMIT_S = 60.0


# One byte each, from a worker that is ready, to a worker that should step, and back when it has.
_READY, _GO, _DONE = b"r", b"g", b"d"


class Processes(SteppingPath):
    """Processes that each loop over their share of the simulations."""

    name = "processes"
    summary = "worker processes, each a Python loop over its share"
    closed_loop = True
    options = (Option("processes", "worker processes", (), int),)

    def prepare(self, workload: Workload, options: Options, resources: Resources) -> Prepared:
        """See `SteppingPath.prepare`."""
        count = options["processes"]
        pool = resources.get_or_create(("workers", count), lambda: _WorkerPool(workload, count))
        resources.at_close(pool.close)
        return Prepared(pool.run, *array_callbacks(pool.final_state))

    def snippet(self, workload: Workload, options: Options) -> str:
        """See `SteppingPath.snippet`."""
        return _SNIPPET.format(processes=options["processes"], hold=workload.hold)


@dataclass(frozen=True, eq=False)
class _SharedArray:
    """A float64 array in anonymous shared memory, which lasts as long as a reference to it."""

    memory: Any
    shape: tuple[int, ...]

    @classmethod
    def copy_of(cls, context: SpawnContext, array: np.ndarray) -> "_SharedArray":
        shared = cls(context.RawArray("d", max(1, array.size)), array.shape)
        shared.as_array()[...] = array
        return shared

    def as_array(self) -> np.ndarray:
        values = np.frombuffer(self.memory, dtype=np.float64)
        return values[: int(np.prod(self.shape))].reshape(self.shape)


@dataclass(frozen=True, eq=False)
class _SharedWorkload:
    """A workload in shared memory, as it is sent to the workers."""

    model: mujoco.MjModel
    hold: int
    initial_state: _SharedArray
    control: _SharedArray
    final_state: _SharedArray


class _WorkerPool:
    """Started workers, the memory they share, and a pipe to each."""

    def __init__(self, workload: Workload, count: int):
        context = multiprocessing.get_context("spawn")
        # referenced here for as long as the workers use it: the allocator reuses free memory
        self._shared = _SharedWorkload(
            workload.model,
            workload.hold,
            _SharedArray.copy_of(context, workload.initial_state),
            _SharedArray.copy_of(context, workload.control),
            _SharedArray.copy_of(context, np.full_like(workload.initial_state, np.nan)),
        )
        self.final_state = self._shared.final_state.as_array()
        self.pipes: list[Connection] = []
        self.processes: list[SpawnProcess] = []
        for part in shares(workload.nbatch, count):
            self._start(context, part)
        for pipe in self.pipes:
            if not pipe.poll(_START_LIMIT_S):
                raise TimeoutError(f"a worker process did not start within {_START_LIMIT_S:.0f} s")
            pipe.recv_bytes()

    def _start(self, context: SpawnContext, part: slice) -> None:
        ours, theirs = context.Pipe()
        process = context.Process(target=_serve, args=(theirs, self._shared, part), daemon=True)
        process.start()
        theirs.close()
        self.pipes.append(ours)
        self.processes.append(process)

    def run(self) -> None:
        """Let every worker step its share; return when all have."""
        for pipe in self.pipes:
            pipe.send_bytes(_GO)
        for pipe in self.pipes:
            pipe.recv_bytes()

    def close(self) -> None:
        """End the workers."""
        for pipe in self.pipes:
            pipe.close()  # a waiting worker reads the end of its pipe and returns
        for process in self.processes:
            process.join(1.0)
            if process.is_alive():
                process.kill()
        self.pipes.clear()
        self.processes.clear()


def _serve(pipe: Connection, shared: _SharedWorkload, part: slice) -> None:
    """Be a worker: step the simulations of `part` for each byte, until the pipe closes."""
    child.die_with_parent()
    simulate = make_simulate(shared.model, shared.hold)
    data = mujoco.MjData(shared.model)
    arrays = (shared.initial_state, shared.control, shared.final_state)
    initial_state, control, final_state = (array.as_array()[part] for array in arrays)
    with contextlib.suppress(EOFError, BrokenPipeError, KeyboardInterrupt):
        pipe.send_bytes(_READY)
        while pipe.recv_bytes():
            simulate(data, initial_state, control, final_state)
            pipe.send_bytes(_DONE)


_SNIPPET = """\
import multiprocessing

import mujoco
import numpy as np

def start(model):
    global _model, _data
    _model, _data = model, mujoco.MjData(model)

def work(job):
    full, ends = int(mujoco.mjtState.mjSTATE_INTEGRATION), []
    for row, controls in zip(*job):
        mujoco.mj_setState(_model, _data, row, full)
        for u in controls:  # or u = policy(_data)
            _data.ctrl[:] = u
            mujoco.mj_step(_model, _data, nstep={hold})
        ends.append(np.empty_like(row))
        mujoco.mj_getState(_model, _data, ends[-1], full)
    return ends

if __name__ == "__main__":
    spawn = multiprocessing.get_context("spawn")
    with spawn.Pool({processes}, initializer=start, initargs=(model,)) as pool:
        jobs = zip(np.array_split(initial_state, {processes}), np.array_split(control, {processes}))
        final_state = np.concatenate(pool.map(work, jobs))
"""
