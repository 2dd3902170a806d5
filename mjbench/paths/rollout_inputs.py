"""The arrays that a rollout of a workload starts from.

A rollout resets mocap poses and applied forces, unless they are part of the control; then they
are sent along with every step's control.
"""

from dataclasses import dataclass

import mujoco
import numpy as np

from mjbench.simulation import compat
from mjbench.simulation.workload import Workload

# Inputs that a rollout resets to the model's defaults unless they are part of the control.
_USER_INPUTS = (
    "QFRC_APPLIED",
    "XFRC_APPLIED",
    "EQ_ACTIVE",
    "MOCAP_POS",
    "MOCAP_QUAT",
    "USERDATA",
)


@dataclass(frozen=True, eq=False)
class RolloutInputs:
    """The arrays that a rollout starts from; all variants of a workload share them.

    Attributes:
      start: (nbatch, nphysics) full-physics states.
      warmstart: (nbatch, nv) accelerations.
      control_spec: the mjtState components in a row of `control`.
      control: (nbatch, nstep, ncontrol); None without any.
    """

    start: np.ndarray
    warmstart: np.ndarray
    control_spec: int
    control: np.ndarray | None

    def only(self, i: int) -> "RolloutInputs":
        """Return the inputs of one simulation."""
        row = slice(i, i + 1)
        control = None if self.control is None else self.control[row]
        return RolloutInputs(self.start[row], self.warmstart[row], self.control_spec, control)


def make_inputs(workload: Workload, physics: np.ndarray) -> RolloutInputs:
    """Return the inputs of a workload's rollout.

    Args:
      workload: to roll out.
      physics: (nphysics,) the entries of mjSTATE_INTEGRATION that form mjSTATE_FULLPHYSICS.
    """
    warmstart = _columns(workload)["qacc_warmstart"]
    spec, control = _control(workload)
    return RolloutInputs(
        np.ascontiguousarray(workload.initial_state[:, physics]),
        np.ascontiguousarray(workload.initial_state[:, warmstart]),
        spec,
        control,
    )


def changed_inputs(workload: Workload) -> list[str]:
    """Return the inputs (by mjtState name) that differ from what a rollout resets them to."""
    default, columns = mujoco.MjData(workload.model), _columns(workload)
    changed = []
    for name in _USER_INPUTS:
        field = name.lower()
        if field in columns:
            values = workload.initial_state[:, columns[field]]
            if np.any(values != np.asarray(getattr(default, field), dtype=float).ravel()):
                changed.append(name)
    return changed


def _control(workload: Workload) -> tuple[int, np.ndarray | None]:
    """Return the control specification and (nbatch, nstep, ncontrol) controls of a rollout."""
    spec = compat.state_spec("CTRL")
    inputs = changed_inputs(workload)
    if not inputs:
        return spec, np.ascontiguousarray(workload.step_control) if workload.model.nu else None
    for name in inputs:
        spec |= compat.state_spec(name)
    columns = _columns(workload)
    parts = [
        workload.step_control
        if field == "ctrl"
        else np.repeat(workload.initial_state[:, None, columns[field]], workload.nstep, axis=1)
        for field in compat.state_columns(workload.model, spec)
    ]
    return spec, np.concatenate(parts, axis=2)


def _columns(workload: Workload) -> dict[str, slice]:
    return compat.state_columns(workload.model, compat.state_spec("INTEGRATION"))
