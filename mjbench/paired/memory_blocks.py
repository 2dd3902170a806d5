"""How much memory a process takes up: at its peak, and how much its steps add.

This module runs in the environment of any release: it needs the standard library, NumPy and MuJoCo.
"""

import ctypes
import gc
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import mujoco

from mjbench.errors import UnavailableError
from mjbench.host import machine
from mjbench.measuring import calls
from mjbench.paired.loop_sections import LoopSection
from mjbench.paired.metrics import GROWTH_UNIT_BYTES, Metric
from mjbench.paired.worker import Worker, activity
from mjbench.simulation import compat
from mjbench.simulation.workload import Workload

# Steps or calls of a block whose growth is measured. Memory is counted in pages: one more of 4 KiB
# is then 0.2 % of GROWTH_UNIT_BYTES.
GROWTH_NSTEP = 2000


def growth_section(
    step: Callable[[], None], nstep: int, resident_bytes: Callable[[], int]
) -> LoopSection:
    """Return a block whose reading is what 1,000 steps add to memory, with GROWTH_UNIT_BYTES.

    Memory that is given back is no growth: the reading is never less than the unit.
    """
    before_bytes = 0

    def begin() -> None:
        nonlocal before_bytes
        before_bytes = resident_bytes()

    def reading() -> int:
        growth = max(0, resident_bytes() - before_bytes)
        return GROWTH_UNIT_BYTES + round(1000 * growth / nstep)

    return LoopSection(step, begin, reading=reading)


def used_bytes() -> int:
    """Return the memory of this process, without what may be collected or is free.

    An allocator keeps memory that was freed for later, where it pleases: glibc gives it back.

    Raises:
      UnavailableError: the system does not say.
    """
    gc.collect()
    if malloc_trim := getattr(ctypes.CDLL(None), "malloc_trim", None):
        malloc_trim(0)
    resident_bytes = machine.resident_bytes()
    if resident_bytes is None:
        raise UnavailableError("growth of memory is measured under Linux only")
    return resident_bytes


def section_of(metric: Metric, step: Callable[[], None], nstep: int) -> LoopSection:
    """Return the blocks that say what steps took at most, once they are done, or what they add."""
    if metric == Metric.MEMORY:
        step()
        return LoopSection(calls.nothing, reading=machine.peak_memory_bytes)
    used_bytes()
    return growth_section(step, nstep, used_bytes)


@activity("measuring memory")
def prepare_growth(worker: Worker, cores: Sequence[int]) -> int:
    """Have blocks say what steps add, and run one; return how many nanoseconds it takes."""

    def section() -> LoopSection:
        return section_of(Metric.GROWTH, _stepping(worker.workload, GROWTH_NSTEP), GROWTH_NSTEP)

    return worker.prepare_section(cores, section)


@activity("measuring memory")
def prepare_peak(
    worker: Worker, file: Path, options: Mapping[str, str], workload_file: Path
) -> int:
    """Load a model, do a workload, and have blocks say the peak; return how many ns it took."""
    begin = time.perf_counter_ns()
    worker.load_model("", file, options)
    worker.read_workload(workload_file)
    nstep = worker.workload.nbatch * worker.workload.nstep
    step = _stepping(worker.workload, nstep)
    worker.sections = [section_of(Metric.MEMORY, step, nstep)]
    return time.perf_counter_ns() - begin


@activity("measuring the arena")
def prepare_arena(worker: Worker) -> int:
    """Do a workload, and have blocks say the peak of its arena; return how many ns it took."""
    most_bytes, begin = 0, time.perf_counter_ns()

    def look(data: mujoco.MjData) -> None:
        nonlocal most_bytes  # a reset forgets it
        most_bytes = max(most_bytes, int(data.maxuse_arena))

    _stepping(worker.workload, worker.workload.nbatch * worker.workload.nstep, look)()
    worker.sections = [LoopSection(calls.nothing, reading=lambda: most_bytes)]
    return time.perf_counter_ns() - begin


def _stepping(
    workload: Workload, nstep: int, look: Callable[[mujoco.MjData], None] = lambda data: None
) -> Callable[[], None]:
    """Return what takes `nstep` steps in the plain loop: those of a workload, again and again."""
    model, hold = workload.model, workload.hold
    data, mj_step = mujoco.MjData(model), mujoco.mj_step

    def step() -> None:
        left = nstep
        while left > 0:
            for start, controls in zip(workload.initial_state, workload.control, strict=True):
                compat.restart(model, data, start)
                for values in controls[: -(-left // hold)]:
                    data.ctrl[:] = values
                    mj_step(model, data, hold)
                look(data)
                left -= hold * len(controls)
                if left <= 0:
                    return

    return step
