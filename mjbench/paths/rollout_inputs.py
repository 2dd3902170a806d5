"""The arrays that a rollout of a workload starts from.

A rollout resets mocap poses and applied forces, unless they are part of the control; then they
are sent along with every step's control.
"""

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np

from mjbench.paths.base import Resources
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
      start: (nbatch, nphysics) states.
      warmstart: (nbatch, nv) accelerations.
      control_spec: mjtState components in a row of `control`.
      control: (nbatch, nstep, ncontrol); None without any.
    """

    start: np.ndarray
    warmstart: np.ndarray
    control_spec: int
    control: np.ndarray | None


def shared_inputs(workload: Workload, resources: Resources) -> RolloutInputs:
    """Return the inputs of a workload's rollout, the same ones to every caller.

    They follow changes of the workload's arrays.
    """
    return resources.get_or_create(  # type: ignore[no-any-return]
        "rollout inputs", lambda: _make_inputs(workload, resources)
    )


def _make_inputs(workload: Workload, resources: Resources) -> RolloutInputs:
    physics = compat.physics_entries(workload.model)
    warmstart = compat.state_columns(workload.model)["qacc_warmstart"]
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

    resources.at_change(follow)
    return inputs


def changed_inputs(workload: Workload) -> list[str]:
    """Return the inputs (by mjtState name) that differ from what a rollout resets them to."""
    default, columns = mujoco.MjData(workload.model), compat.state_columns(workload.model)
    changed = []
    for name in _USER_INPUTS:
        field = name.lower()
        if field in columns:
            values = workload.initial_state[:, columns[field]]
            if np.any(values != np.asarray(getattr(default, field), dtype=float).ravel()):
                changed.append(name)
    return changed


def inputs_snippet(workload: Workload) -> str:
    """Return lines that make the inputs of a rollout in Python code for people to paste.

    They use `data`, a list of MjData, and leave `start`, `warmstart` and `control`; and `spec`, the
    components in a row of `control`, where these are not those of `ctrl` alone.
    """
    lines = _SNIPPET_STARTS
    if workload.hold > 1:
        lines += f"control = np.repeat(control, {workload.hold}, axis=1)\n"
    inputs = changed_inputs(workload)
    if inputs:
        bits = "".join(f" | mujoco.mjtState.mjSTATE_{name}" for name in inputs)
        lines += _SNIPPET_CONTROL.format(bits=bits)
    return lines


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
    columns = compat.state_columns(workload.model)
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


_SNIPPET_STARTS = """\
start, warmstart = [], []
for row in initial_state:
    mujoco.mj_setState(model, data[0], row, int(full))
    start.append(np.empty(mujoco.mj_stateSize(model, int(physics))))
    mujoco.mj_getState(model, data[0], start[-1], int(physics))
    warmstart.append(data[0].qacc_warmstart.copy())
"""

_SNIPPET_CONTROL = """\
# a rollout resets mocap poses and applied forces, unless they are part of the control
spec = mujoco.mjtState.mjSTATE_CTRL{bits}
inputs = np.empty((*control.shape[:2], mujoco.mj_stateSize(model, int(spec))))
for i, row in enumerate(initial_state):
    mujoco.mj_setState(model, data[0], row, int(full))
    given = np.empty(inputs.shape[2])
    mujoco.mj_getState(model, data[0], given, int(spec))
    inputs[i] = given
inputs[:, :, : model.nu] = control
control = inputs
"""
