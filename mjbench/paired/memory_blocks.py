"""How much memory a process takes up at its peak.

This module runs in the environment of any release: it needs the standard library, NumPy and MuJoCo.
"""

import time
from collections.abc import Callable, Mapping
from pathlib import Path

import mujoco

from mjbench.host import machine
from mjbench.measuring import calls
from mjbench.paired.loop_sections import LoopSection
from mjbench.paired.worker import Worker, activity
from mjbench.simulation import compat
from mjbench.simulation.workload import Workload


def peak_section(step: Callable[[], None]) -> LoopSection:
    """Take steps; return a block that reads the peak of this process."""
    step()
    return LoopSection(calls.nothing, reading=machine.peak_memory_bytes)


@activity("measuring memory")
def prepare_peak(
    worker: Worker, file: Path, options: Mapping[str, str], workload_file: Path
) -> int:
    """Load a model, do a workload, and have blocks say the peak; return how many ns it took."""
    begin = time.perf_counter_ns()
    worker.load_model("", file, options)
    worker.read_workload(workload_file)
    worker.sections = [peak_section(_stepping(worker.workload))]
    return time.perf_counter_ns() - begin


def _stepping(workload: Workload) -> Callable[[], None]:
    """Return what does a workload once, in the plain loop."""
    model, hold = workload.model, workload.hold
    data, mj_step = mujoco.MjData(model), mujoco.mj_step

    def step() -> None:
        for start, controls in zip(workload.initial_state, workload.control, strict=True):
            compat.restart(model, data, start)
            for values in controls:
                data.ctrl[:] = values
                mj_step(model, data, hold)

    return step
