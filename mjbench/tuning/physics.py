"""What the present model says of states that runs have reached: contact, constraints, energy.

All states are judged by one model, the user's own, so a setting cannot hide what it leaves out.
"""

from dataclasses import dataclass

import mujoco
import numpy as np

from mjbench.simulation import compat

_LIMITS = ("mjCNSTR_LIMIT_JOINT", "mjCNSTR_LIMIT_TENDON")


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

    penetration_m: float
    violation: float
    energy_drift_j: float
    contact_force_n: float


def physics(model: mujoco.MjModel, initial_state: np.ndarray, points: np.ndarray) -> Physics:
    """Return what a model says of states.

    Args:
      initial_state: (nrun, nstate) where the runs began, rows of mjSTATE_INTEGRATION.
      points: (nrun, npoint, nstate) states along the runs.
    """
    data = mujoco.MjData(model)
    rows = []
    for start, states in zip(initial_state, points, strict=True):
        _forward(model, data, start)
        energy_j = _energy_j(model, data)
        for state in states:
            _forward(model, data, state)
            rows.append(
                (
                    max(0.0, -float(np.min(data.contact.dist[: data.ncon], initial=0.0))),
                    _violation(data),
                    abs(_energy_j(model, data) - energy_j),
                    _contact_force_n(model, data),
                )
            )
    return Physics(*(float(mean) for mean in np.mean(rows, axis=0)))


def _forward(model: mujoco.MjModel, data: mujoco.MjData, state: np.ndarray) -> None:
    compat.restart(model, data, np.ascontiguousarray(state))
    mujoco.mj_forward(model, data)


def _energy_j(model: mujoco.MjModel, data: mujoco.MjData) -> float:
    mujoco.mj_energyPos(model, data)
    mujoco.mj_energyVel(model, data)
    return float(np.sum(data.energy))


def _violation(data: mujoco.MjData) -> float:
    kinds = np.asarray(data.efc_type[: data.nefc])
    position = np.asarray(data.efc_pos[: data.nefc])
    is_equality = kinds == int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)
    is_limit = np.isin(kinds, [int(getattr(mujoco.mjtConstraint, name)) for name in _LIMITS])
    equality = float(np.max(np.abs(position[is_equality]), initial=0.0))
    return max(equality, float(np.max(-position[is_limit], initial=0.0)))


def _contact_force_n(model: mujoco.MjModel, data: mujoco.MjData) -> float:
    force = np.empty(6)
    total = 0.0
    for i in range(data.ncon):
        mujoco.mj_contactForce(model, data, i, force)
        total += float(force[0])
    return total
