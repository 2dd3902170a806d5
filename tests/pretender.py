"""An accelerated path that is C under another name, for tests of what checks it."""

from typing import Any

import numpy as np
import pytest

from mjbench import paths
from mjbench.paths.accelerated import (
    AcceleratedPath,
    Compiled,
    StepOutcome,
    final,
    start_fields,
)
from mjbench.paths.base import States
from mjbench.simulation import models, trajectory, workload

FREE = "cartpole"
NBATCH, NSTEP = 4, 20


def made(name: str = FREE, nbatch: int = NBATCH, nstep: int = NSTEP) -> workload.Workload:
    return workload.make(models.load(models.resolve(name)), nbatch, nstep, hold=2)


def available(name: str) -> AcceleratedPath:
    """Return an accelerated path; skip the test where its packages are missing."""
    path = paths.find(name)
    assert isinstance(path, AcceleratedPath)
    reason = path.unavailable()
    if reason:
        pytest.skip(reason)
    return path


class Pretender(AcceleratedPath):
    """C itself under another name, with something wrong, to see what the check makes of it."""

    name = "pretender"
    summary = "wrong on purpose"
    precision = "float64"
    extra = "none"
    packages = ()

    def __init__(self, wrong: str = "") -> None:
        self.wrong = wrong

    def device_kind(self) -> str:
        return "cpu"

    def fields(self, model: Any) -> Any:
        return workload.fields(model, made().initial_state)

    def snippet(self, workload: Any, options: Any) -> str:
        return ""

    def compiled(self, work: Any, options: Any, peaks: Any) -> Compiled:
        def advance(fields: Any, control: np.ndarray, nstep: int) -> StepOutcome:
            rows = workload.states(work.model, fields)
            if self.wrong == "control":
                control = np.roll(control, 1, axis=0) + 0.1
            given = workload.Workload(work.model, rows, control, work.hold, 0)
            states = trajectory.run(with_steps(given, nstep), work.nbatch).states
            after = workload.fields(work.model, states[:, nstep])
            after.pop("ctrl", None)
            if self.wrong == "nan":
                after["qvel"][1] = np.nan
            if self.wrong == "many" and len(rows) > 256:  # as if a buffer ended there
                after["qpos"][256:] = fields["qpos"][256:]
            after["ctrl"] = given.step_control[:, max(nstep - 1, 0)]
            if self.wrong == "step" and nstep > 1:
                after |= workload.fields(work.model, states[:, nstep - 1])
            if self.wrong == "still":
                after |= fields
            if self.wrong == "start":
                after["qpos"] = after["qpos"] + 1e-16
            return StepOutcome(after, None)

        def final_states() -> States:
            nstep = work.nstep - {"block": 1, "idle": work.nstep}.get(self.wrong, 0)
            return final(work, advance(start_fields(work), work.control, nstep).fields)

        return Compiled(_nothing, _nothing, final_states, device="cpu", advance=advance)


def _nothing() -> None:
    pass


def with_steps(work: workload.Workload, nstep: int) -> workload.Workload:
    """Return a workload of as many steps, each with the control that it would have had."""
    control = np.ascontiguousarray(work.step_control[:, :nstep])
    return workload.Workload(work.model, work.initial_state, control, 1, 0)
