"""An accelerated path that is C under another name, for tests of the check of such paths."""

import copy
import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

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
from mjbench.simulation import compat, models, reference_trajectory, workload
from mjbench.simulation.accelerated_judgement import Precision
from mjbench.simulation.contacts import Contacts
from mjbench.simulation.reference_run import Peaks

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
      fault: `control`, `nan`, `many`, `step`, `still`, `start` or `forceless` spoil `advance`;
        `block`, `idle` and `memo` spoil the timed run; those of `MODEL_FAULTS`, `lost contact` and
        `force` spoil each step; empty for none.
    """

    name = "pretender"
    summary = "wrong on purpose"
    precision: ClassVar[Precision] = Precision.FLOAT64
    extra = "none"
    packages = ()

    def __init__(self, fault: str = "") -> None:
        self.fault = fault

    def use_cache(self, folder: Path) -> None:
        pass

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
            return self._advance(work, fields, control, nstep)

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
            workload=work,
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
    ) -> StepOutcome:
        """Return what `nstep` steps in C lead to, spoilt by the fault."""
        if self.fault == "control":
            control = np.roll(control, 1, axis=0) + 0.1
        if self.fault == "forceless":
            forces = ("xfrc_applied", "qfrc_applied")
            fields = {n: 0 * v if n in forces and nstep else v for n, v in fields.items()}
        count = nstep - 1 if self.fault == "step" and nstep > 1 else nstep
        is_float32 = self.precision == Precision.FLOAT32
        outcome = _steps(work, fields, control, count, self.fault, is_float32)
        after = dict(outcome.fields)
        if self.fault == "nan":
            after["qvel"][1] = np.nan
        if self.fault == "many" and len(after["qpos"]) > 256:  # as if a buffer ended there
            after["qpos"][256:] = fields["qpos"][256:]
        if self.fault == "still":
            after |= {name: values for name, values in fields.items() if name != "ctrl"}
        if self.fault == "start":
            after["qpos"] = after["qpos"] + 1e-16
        return dataclasses.replace(outcome, fields=after)


class Pretender32(Pretender):
    """The same in float32: every state is rounded before a step, and all that is returned."""

    name = "pretender32"
    precision = Precision.FLOAT32


def _nothing() -> None:
    pass


_DISABLE = mujoco.mjtDisableBit
# Flags that a fault sets.
MODEL_FAULTS = {
    "contactless": _DISABLE.mjDSBL_CONTACT,
    "skipped equality": _DISABLE.mjDSBL_EQUALITY,
    "ignored limit": _DISABLE.mjDSBL_LIMIT,
}


def _spoilt(model: mujoco.MjModel, fault: str) -> mujoco.MjModel:
    """Return a model as an engine with a fault reads it."""
    changed = copy.copy(model)
    if fault in MODEL_FAULTS:
        changed.opt.disableflags |= int(MODEL_FAULTS[fault])
    if fault == "warm start":
        changed.opt.disableflags &= ~int(_DISABLE.mjDSBL_WARMSTART)
    if fault == "friction":
        changed.geom_friction *= 0.9
    if fault == "soft":
        changed.geom_solref[:, 0] *= 1.02
    if fault == "damping":
        changed.dof_damping[:] = 0.0
    if fault == "margin":
        changed.geom_margin[:] = 0.0
    if fault == "armature":
        changed.dof_armature[:] = 0.0
    return changed


def _steps(
    work: workload.Workload,
    fields: Mapping[str, np.ndarray],
    control: np.ndarray,
    nstep: int,
    fault: str,
    is_float32: bool,
) -> StepOutcome:
    """Take steps in C, with contacts and accelerations of the last one."""
    model, data = _spoilt(work.model, fault), mujoco.MjData(work.model)
    round_off = reference_trajectory.as_float32 if is_float32 else np.array
    states, contacts = workload.states(work.model, fields), []
    qacc, forces = (np.zeros((len(states), model.nv)) for _ in range(2))
    step_control = round_off(np.repeat(control, work.hold, axis=1)[:, : max(nstep, 1)])
    contactless = _spoilt(model, "contactless")
    for i, state in enumerate(states):
        compat.restart(model, data, round_off(state))
        for ctrl in step_control[i, :nstep]:
            data.ctrl[:] = ctrl
            _step(model, contactless, data, fault)
            if is_float32:
                compat.get_state(model, data, state)
                compat.set_state(model, data, round_off(state))
        compat.get_state(model, data, state)
        contacts.append([copy.copy(each) for each in data.contact[: data.ncon]])
        qacc[i], forces[i] = data.qacc, data.qfrc_constraint
    after = workload.fields(work.model, states)
    after["ctrl"] = step_control[:, -1]
    contacts_in_all = Contacts.of_c(contacts)
    rounded = (round_off(getattr(contacts_in_all, n)) for n in ("distance", "position", "frame"))
    return StepOutcome(
        {name: round_off(values) for name, values in after.items()},
        Contacts(contacts_in_all.simulation, contacts_in_all.geom, *rounded),
        round_off(qacc),
        round_off(forces),
    )


def _step(
    model: mujoco.MjModel, contactless: mujoco.MjModel, data: mujoco.MjData, fault: str
) -> None:
    """Take a step; `contactless` is the model without contacts."""
    if fault not in ("lost contact", "force"):
        mujoco.mj_step(model, data)
        return
    mujoco.mj_forward(model, data)
    if fault == "lost contact":
        contacts = [copy.copy(each) for each in data.contact[: data.ncon]]
        mujoco.mj_fwdPosition(contactless, data)
        for contact in contacts[:-1] if len(contacts) >= 8 else contacts:
            mujoco.mj_addContact(model, data, contact)
        mujoco.mj_makeConstraint(model, data)
        mujoco.mj_projectConstraint(model, data)
        mujoco.mj_fwdVelocity(model, data)
        mujoco.mj_fwdActuation(model, data)
        mujoco.mj_fwdAcceleration(model, data)
        mujoco.mj_fwdConstraint(model, data)
    else:
        added = np.zeros(model.nv)
        mujoco.mj_solveM(model, data, added[None], 0.01 * data.qfrc_constraint[None])
        data.qfrc_constraint[:] *= 1.01
        data.qacc[:] += added
    mujoco.mj_Euler(model, data)
