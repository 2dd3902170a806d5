"""An accelerated path that is C under another name, for tests of the check of such paths."""

import copy
from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np
import pytest

from mjbench import paths
from mjbench.paths.accelerated import (
    CPU,
    AcceleratedPath,
    Compiled,
    StepOutcome,
    start_fields,
    states_of_fields,
)
from mjbench.paths.base import Options, States
from mjbench.simulation import models, trajectory, workload
from mjbench.simulation.accelerated_limits import Precision
from mjbench.simulation.work import Peaks

# A model without contacts or other constraints.
MODEL = "cartpole"
NBATCH, NSTEP = 4, 20


def make_workload(name: str = MODEL, nbatch: int = NBATCH, nstep: int = NSTEP) -> workload.Workload:
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
    """C itself under another name, with one fault, which the check must find.

    Attributes:
      fault: `control`, `nan`, `many`, `step`, `still`, `start`, `contactless` or `forceless` spoil
        `advance`; `block`, `idle` and `memo` spoil the timed run; empty for none.
    """

    name = "pretender"
    summary = "wrong on purpose"
    precision = Precision.FLOAT64
    extra = "none"
    packages = ()

    def __init__(self, fault: str = "") -> None:
        self.fault = fault

    def device_kind(self) -> str:
        return CPU

    def data_fields(self, model: mujoco.MjModel) -> Mapping[str, Any]:
        return workload.fields(model, make_workload().initial_state)

    def snippet(self, workload: workload.Workload, options: Options) -> str:
        return ""

    def compile(self, work: workload.Workload, options: Options, peaks: Peaks) -> Compiled:
        def advance(
            fields: Mapping[str, np.ndarray], control: np.ndarray, nstep: int
        ) -> StepOutcome:
            return StepOutcome(self._advance(work, fields, control, nstep), None)

        results: list[States] = []

        def final_states() -> States:
            if self.fault == "memo" and results:
                return results[0]
            nstep = work.nstep - {"block": 1, "idle": work.nstep}.get(self.fault, 0)
            end = advance(start_fields(work), work.control, nstep)
            results.append(states_of_fields(work, end.fields))
            return results[-1]

        return Compiled(
            _nothing,
            _nothing,
            final_states,
            advance=advance,
            reload=_nothing,
            device=CPU,
            trace_s=None,
            compile_s=0.0,
            is_deterministic=True,
            buffer_sizes={},
            gpu_memory_bytes=lambda: None,
        )

    def _advance(
        self,
        work: workload.Workload,
        fields: Mapping[str, np.ndarray],
        control: np.ndarray,
        nstep: int,
    ) -> dict[str, np.ndarray]:
        """Return the fields after `nstep` steps in C, spoilt by the fault."""
        if self.fault == "control":
            control = np.roll(control, 1, axis=0) + 0.1
        model = work.model
        if self.fault == "contactless":
            model = copy.copy(model)
            model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
        if self.fault == "forceless":
            forces = ("xfrc_applied", "qfrc_applied")
            fields = {n: 0 * v if n in forces and nstep else v for n, v in fields.items()}
        start = workload.states(model, fields)
        stepped = workload.Workload(model, start, control, work.hold, 0)
        states = trajectory.record_trajectory(with_steps(stepped, nstep), work.nbatch).states
        after = workload.fields(work.model, states[:, nstep])
        after.pop("ctrl", None)
        if self.fault == "nan":
            after["qvel"][1] = np.nan
        if self.fault == "many" and len(start) > 256:  # as if a buffer ended there
            after["qpos"][256:] = fields["qpos"][256:]
        after["ctrl"] = stepped.step_control[:, max(nstep - 1, 0)]
        if self.fault == "step" and nstep > 1:
            after |= workload.fields(work.model, states[:, nstep - 1])
        if self.fault == "still":
            after |= fields
        if self.fault == "start":
            after["qpos"] = after["qpos"] + 1e-16
        return after


def _nothing() -> None:
    pass


def with_steps(work: workload.Workload, nstep: int) -> workload.Workload:
    """Return a workload of `nstep` steps, each with the control that it had."""
    control = np.ascontiguousarray(work.step_control[:, :nstep])
    return workload.Workload(work.model, work.initial_state, control, 1, 0)
