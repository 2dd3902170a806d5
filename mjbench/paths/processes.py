"""Worker processes, each with its own MjModel and MjData, started before the timed region.

States and controls are in memory shared with the workers; a run sends each worker one byte and
waits for one byte back. Workers end when the parent does, however it ends.
"""

import contextlib
import multiprocessing
import textwrap
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnContext, SpawnProcess
from typing import Any

import mujoco
import numpy as np

from mjbench.host import child
from mjbench.paths import snippets
from mjbench.paths.base import (
    Option,
    Options,
    Prepared,
    Resources,
    SteppingPath,
    make_simulate,
    prepared_arrays,
)
from mjbench.paths.threads import shares
from mjbench.simulation.workload import Product, StepOutputs, Workload

_START_LIMIT_S = 60.0


# One byte each, from a worker that is ready, to a worker that should step, and back when it has.
_READY, _GO, _DONE = b"r", b"g", b"d"


class Processes(SteppingPath):
    """Processes that each loop over their share of the simulations."""

    name = "processes"
    summary = "worker processes, each a Python loop over its share"
    title = "worker processes"
    closed_loop = True
    products = tuple(Product)
    options = (Option("processes", "worker processes", (), int),)

    def prepare(self, workload: Workload, options: Options, resources: Resources) -> Prepared:
        count = options["processes"]
        pool = resources.get_or_create(("workers", count), lambda: _StepperPool(workload, count))
        resources.at_close(pool.close)
        resources.at_change(pool.share_inputs)
        return prepared_arrays(pool.run, pool.final_state, pool.outputs)

    def snippet(self, workload: Workload, options: Options) -> str:
        names = ("final_state", *snippets.output_names(workload))
        allocate = snippets.allocation(workload)
        return _SNIPPET.format(
            processes=options["processes"],
            allocate=textwrap.indent(allocate, "    "),
            count=snippets.counter(workload, indent=8),
            step=snippets.data_steps(workload, indent=12, row="i"),
            names=", ".join(names) + ("," if len(names) == 1 else ""),
        )


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
    model: mujoco.MjModel
    hold: int
    returns: Product
    initial_state: _SharedArray
    control: _SharedArray
    final_state: _SharedArray
    step_outputs: tuple[_SharedArray, ...]

    def outputs(self) -> StepOutputs:
        state, sensordata = (*(array.as_array() for array in self.step_outputs), None, None)[:2]
        return StepOutputs(state, sensordata)


class _StepperPool:
    def __init__(self, workload: Workload, count: int):
        context = multiprocessing.get_context("spawn")
        self._workload = workload
        # referenced here for as long as the workers use it: the allocator reuses free memory
        self._shared = _SharedWorkload(
            workload.model,
            workload.hold,
            workload.returns,
            _SharedArray.copy_of(context, workload.initial_state),
            _SharedArray.copy_of(context, workload.control),
            _SharedArray.copy_of(context, np.full_like(workload.initial_state, np.nan)),
            tuple(_SharedArray.copy_of(context, a) for a in StepOutputs.empty(workload).arrays),
        )
        self.final_state = self._shared.final_state.as_array()
        self.outputs = self._shared.outputs()
        self.pipes: list[Connection] = []
        self.processes: list[SpawnProcess] = []
        for part in shares(workload.nbatch, count):
            ours, theirs = context.Pipe()
            process = context.Process(target=_serve, args=(theirs, self._shared, part), daemon=True)
            process.start()
            theirs.close()
            self.pipes.append(ours)
            self.processes.append(process)
        for pipe in self.pipes:
            if not pipe.poll(_START_LIMIT_S):
                raise TimeoutError(f"a worker process did not start within {_START_LIMIT_S:.0f} s")
            pipe.recv_bytes()

    def share_inputs(self) -> None:
        self._shared.initial_state.as_array()[...] = self._workload.initial_state
        self._shared.control.as_array()[...] = self._workload.control

    def run(self) -> None:
        for pipe in self.pipes:
            pipe.send_bytes(_GO)
        for pipe in self.pipes:
            pipe.recv_bytes()

    def close(self) -> None:
        for pipe in self.pipes:
            pipe.close()  # a waiting worker reads the end of its pipe and returns
        for process in self.processes:
            process.join(1.0)
            if process.is_alive():
                process.kill()
        self.pipes.clear()
        self.processes.clear()


def _serve(pipe: Connection, shared: _SharedWorkload, part: slice) -> None:
    """Step the simulations of `part` for each byte, until the pipe closes."""
    child.die_with_parent()
    simulate = make_simulate(shared.model, shared.hold, shared.returns)
    data = mujoco.MjData(shared.model)
    arrays = (shared.initial_state, shared.control, shared.final_state)
    initial_state, control, final_state = (array.as_array()[part] for array in arrays)
    outputs = shared.outputs().part(part)
    with contextlib.suppress(EOFError, BrokenPipeError, KeyboardInterrupt):
        pipe.send_bytes(_READY)
        while pipe.recv_bytes():
            simulate(data, initial_state, control, final_state, outputs)
            pipe.send_bytes(_DONE)


_SNIPPET = """\
import multiprocessing

import mujoco
import numpy as np

def start(its_model):
    global model, data
    model, data = its_model, mujoco.MjData(its_model)

def work(job):
    initial_state, control = job
    full = int(mujoco.mjtState.mjSTATE_INTEGRATION)
    final_state = np.empty_like(initial_state)
{allocate}    for i, row in enumerate(initial_state):
        mujoco.mj_setState(model, data, row, full)
{count}        for u in control[i]:  # or u = policy(data), of which each process needs its own
            data.ctrl[:] = u
{step}        mujoco.mj_getState(model, data, final_state[i], full)
    return {names}

if __name__ == "__main__":
    spawn = multiprocessing.get_context("spawn")
    with spawn.Pool({processes}, initializer=start, initargs=(model,)) as pool:
        jobs = zip(np.array_split(initial_state, {processes}), np.array_split(control, {processes}))
        {names} = map(np.concatenate, zip(*pool.map(work, jobs)))
"""
