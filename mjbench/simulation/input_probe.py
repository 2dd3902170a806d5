"""A workload in which every input of a step counts: what a path drops or resets changes its states.

In a typical workload most inputs have their defaults (no applied forces, no user data), so a path
that loses them would agree. Forces are small; they are for verification, and are not timed.
"""

import dataclasses
from collections.abc import Collection

import mujoco
import numpy as np

from mjbench.simulation import compat
from mjbench.simulation.workload import Workload

# Accelerations by which forces are applied, in m/s² or rad/s² (standard deviation); offsets of
# mocap poses, in m and rad; and of activations and the states of plugins.
ACCELERATION_SD = 0.1
MOCAP_SD = 1e-3
STATE_SD = 1e-3


def with_every_input(workload: Workload, seed: int) -> Workload:
    """Return a workload whose start states have a non-trivial value in every input."""
    states = set_inputs(workload.model, workload.initial_state, seed)
    return dataclasses.replace(workload, initial_state=states, control=workload.control.copy())


def set_inputs(
    model: mujoco.MjModel, states: np.ndarray, seed: int, fields: Collection[str] | None = None
) -> np.ndarray:
    """Return states with a non-trivial value in every input, or in those of some MjData fields."""
    rng, changed = np.random.default_rng([seed, 3]), states.copy()
    columns = compat.state_columns(model)
    for i, row in enumerate(changed):
        for field, place in columns.items():
            if field == "eq_active" and (fields is None or field in fields):
                row[place] = _with_one_changed(row[place], i)
            elif fields is None or field in fields:
                noise = rng.standard_normal(row[place].shape)
                row[place] = _input_value(model, field, row[place], noise)
    return changed


def _input_value(
    model: mujoco.MjModel, field: str, value: np.ndarray, noise: np.ndarray
) -> np.ndarray:
    """Return a non-trivial value; time, positions, velocities, warm-starts and others have one."""
    match field:
        case "qfrc_applied":
            return np.asarray(ACCELERATION_SD * np.asarray(model.dof_M0) * noise)
        case "xfrc_applied":
            mass = np.repeat(np.asarray(model.body_mass)[:, None], 3, axis=1)
            inertia = np.hstack([mass, np.asarray(model.body_inertia)])
            return np.asarray(ACCELERATION_SD * inertia.ravel() * noise)
        case "mocap_pos":
            return value + MOCAP_SD * noise
        case "mocap_quat":
            quaternions = (value + MOCAP_SD * noise).reshape(-1, 4)
            norms = np.linalg.norm(quaternions, axis=1, keepdims=True)
            return np.asarray((quaternions / norms).ravel())
        case "userdata":
            return noise
        case "act":
            return _activations(model, value + STATE_SD * noise)
        case "plugin_state":
            return value + STATE_SD * noise
        case _:
            return value


def _with_one_changed(active: np.ndarray, i: int) -> np.ndarray:
    """Return which constraints are active in simulation i, another one changed than in i - 1.

    One of them is inactive instead, or active if all were not: releasing a constraint is gentler
    than imposing one. Where there is a choice of one, every second simulation keeps it.
    """
    candidates = np.flatnonzero(active) if active.any() else np.arange(len(active))
    changed = active.copy()
    if len(candidates) > 1 or i % 2 == 0:
        chosen = candidates[i % len(candidates)]
        changed[chosen] = 1 - changed[chosen]
    return changed


def _activations(model: mujoco.MjModel, act: np.ndarray) -> np.ndarray:
    clipped = act.copy()
    for i in np.flatnonzero(model.actuator_actlimited):
        first, count = int(model.actuator_actadr[i]), int(model.actuator_actnum[i])
        if count:
            place = slice(first, first + count)
            clipped[place] = np.clip(clipped[place], *model.actuator_actrange[i])
    return clipped
