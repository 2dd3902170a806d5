"""What the present model says of states that runs have reached: contact, constraints, energy.

All states are judged by one model, the user's own, so a setting cannot hide what it leaves out.
"""

from dataclasses import dataclass

import mujoco
import numpy as np

from mjbench.bounds import AnyFloat
from mjbench.simulation import compat
from mjbench.verification.accelerated_run_statistics import (
    contact_force_n,
    penetration_m,
    violation,
)


@dataclass(frozen=True)
class Physics:
    """Means over states along runs.

    Attributes:
      penetration_m: the deepest contact of a state, in m; 0 without contact.
      violation: the largest violation of an equality or a limit of a state, in m or rad.
      energy_drift_j: the magnitude of the change of potential and kinetic energy since the start,
        in J.
      contact_force_n: sum of the normal forces of a state's contacts, in N.
    """

    penetration_m: AnyFloat
    violation: AnyFloat
    energy_drift_j: AnyFloat
    contact_force_n: AnyFloat


def physics(model: mujoco.MjModel, initial_state: np.ndarray, points: np.ndarray) -> Physics:
    """Return what a model says of (nrun, npoint, nstate) states from (nrun, nstate) starts."""
    data = mujoco.MjData(model)
    rows = []
    for start, states in zip(initial_state, points, strict=True):
        _forward(model, data, start)
        energy_j = _energy_j(model, data)
        for state in states:
            _forward(model, data, state)
            depth_m, force_n = penetration_m(data), contact_force_n(model, data)
            drift_j = abs(_energy_j(model, data) - energy_j)
            rows.append((depth_m, violation(data), drift_j, force_n))
    return Physics(*(float(mean) for mean in np.mean(rows, axis=0)))


def _forward(model: mujoco.MjModel, data: mujoco.MjData, state: np.ndarray) -> None:
    compat.restart(model, data, np.ascontiguousarray(state))
    mujoco.mj_forward(model, data)


def _energy_j(model: mujoco.MjModel, data: mujoco.MjData) -> float:
    mujoco.mj_energyPos(model, data)
    mujoco.mj_energyVel(model, data)
    return float(np.sum(data.energy))
