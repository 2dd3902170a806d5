"""Worker processes, an MjModel and an MjData each, started before the timed region.

States and controls lie in memory shared with the workers; a run sends each worker one byte and
waits for one byte back. Workers end when the parent does, however it ends.
"""

import contextlib
import multiprocessing
from multiprocessing.connection import Connection
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
    fill_from_array,
    needs_reset,
    simulate,
)
from mjbench.paths.threads import shares
from mjbench.simulation.compat import state_spec
from mjbench.simulation.workload import Workload

_START_LIMIT_S = 60.0


class Processes(SteppingPath):
    """Processes that each loop over their share of the simulations."""

    name = "processes"
    summary = "worker processes, each a Python loop over its share"
    closed_loop = True
    options = (Option("processes", "worker processes", (), int),)

    def prepare(self, workload: Workload, options: Options, resources: Resources) -> Prepared:
        """See `SteppingPath.prepare`."""
        count = options["processes"]
        pool = resources.get_or_create(("workers", count), lambda: _Workers(workload, count))
        resources.at_close(pool.close)
        return Prepared(pool.run, *fill_from_array(pool.final_state))

    def snippet(self, workload: Workload, options: Options) -> str:
        """See `SteppingPath.snippet`."""
        return _SNIPPET.format(processes=options["processes"], hold=workload.hold)


class _Workers:
    """Started workers, the memory they share, and a pipe to each."""

    def __init__(self, workload: Workload, count: int):
        context = multiprocessing.get_context("spawn")
        initial_state = _shared(context, workload.initial_state)
        control = _shared(context, workload.control)
        final = _shared(context, np.full_like(workload.initial_state, np.nan))
        # the memory is given to others when its last owner in this process goes
        self._memory = (initial_state, control, final)
        self.final_state = _array(final)
        self.pipes: list[Connection] = []
        self.processes: list[Any] = []
        for part in shares(workload.nbatch, count):
            ours, theirs = context.Pipe()
            process = context.Process(
                target=_serve,
                args=(theirs, workload.model, initial_state, control, final, part, workload.hold),
                daemon=True,
            )
            process.start()
            theirs.close()
            self.pipes.append(ours)
            self.processes.append(process)
        for pipe in self.pipes:
            if not pipe.poll(_START_LIMIT_S):
                raise TimeoutError(f"a worker process did not start within {_START_LIMIT_S:.0f} s")
            pipe.recv_bytes()

    def run(self) -> None:
        """Let every worker step its share; return when all have."""
        for pipe in self.pipes:
            pipe.send_bytes(b"g")
        for pipe in self.pipes:
            pipe.recv_bytes()

    def close(self) -> None:
        """End the workers."""
        for pipe in self.pipes:
            pipe.close()  # a worker that waits sees the end of its pipe and returns
        for process in self.processes:
            process.join(1.0)
            if process.is_alive():
                process.kill()
        self.pipes.clear()
        self.processes.clear()


def _serve(
    pipe: Connection,
    model: mujoco.MjModel,
    initial_state: Any,
    control: Any,
    final: Any,
    part: slice,
    hold: int,
) -> None:
    """Be a worker: step the share `part` whenever a byte arrives, until the pipe closes."""
    child.die_with_parent()
    data, spec, fresh = mujoco.MjData(model), state_spec("INTEGRATION"), needs_reset(model)
    starts, controls, ends = (_array(a)[part] for a in (initial_state, control, final))
    with contextlib.suppress(EOFError, BrokenPipeError, KeyboardInterrupt):
        pipe.send_bytes(b"r")
        while pipe.recv_bytes():
            simulate(model, data, starts, controls, hold, ends, spec, fresh)
            pipe.send_bytes(b"d")


def _shared(context: Any, array: np.ndarray) -> tuple[Any, tuple[int, ...]]:
    """Return a copy of a float64 array in shared memory without a name, and its shape."""
    memory = context.RawArray("d", max(1, array.size))
    shared = (memory, array.shape)
    _array(shared)[...] = array
    return shared


def _array(shared: tuple[Any, tuple[int, ...]]) -> np.ndarray:
    memory, shape = shared
    return np.frombuffer(memory, dtype=np.float64)[: int(np.prod(shape))].reshape(shape)


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
