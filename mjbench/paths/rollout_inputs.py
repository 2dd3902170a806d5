"""The arrays that a rollout of a workload starts from.

A rollout resets mocap poses and applied forces, unless they are part of the control; then they
are sent along with every step's control.
"""

from collections.abc import Callable
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


def make_inputs(
    workload: Workload, physics: np.ndarray
) -> tuple[RolloutInputs, Callable[[], None]]:
    """Return the inputs of a workload's rollout, and a function by which they follow its changes.

    Args:
      workload: to roll out.
      physics: (nphysics,) the entries of mjSTATE_INTEGRATION that form mjSTATE_FULLPHYSICS.
    """
    warmstart = _columns(workload)["qacc_warmstart"]
    spec, control, write_control = _control(workload)
    inputs = RolloutInputs(
        np.ascontiguousarray(workload.initial_state[:, physics]),
        np.ascontiguousarray(workload.initial_state[:, warmstart]),
        spec,
        control,
    )

    def follow() -> None:
        np.take(workload.initial_state, physics, axis=1, out=inputs.start)
        inputs.warmstart[...] = workload.initial_state[:, warmstart]
        write_control()

    return inputs, follow


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


def _control(workload: Workload) -> tuple[int, np.ndarray | None, Callable[[], None]]:
    """Return the control specification of a rollout, its controls, and how they are written.

    Returns:
      The specification; (nbatch, nstep, ncontrol) controls, which are the workload's own where they
      are all that is sent; and a function that writes them where they are not.
    """
    spec = compat.state_spec("CTRL")
    inputs = changed_inputs(workload)
    if not inputs:
        return spec, workload.step_control if workload.model.nu else None, lambda: None
    for name in inputs:
        spec |= compat.state_spec(name)
    columns = _columns(workload)
    places = compat.state_columns(workload.model, spec)
    size = compat.state_size(workload.model, spec)
    control = np.empty((workload.nbatch, workload.nstep, size))

    def write() -> None:
        for field, place in places.items():
            if field == "ctrl":
                control[:, :, place] = workload.step_control
            else:
                control[:, :, place] = workload.initial_state[:, None, columns[field]]

    write()
    return spec, control, write


def _columns(workload: Workload) -> dict[str, slice]:
    return compat.state_columns(workload.model, compat.state_spec("INTEGRATION"))
