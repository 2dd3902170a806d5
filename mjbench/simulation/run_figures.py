"""What states of a run come to where bodies touch: figures that two engines' runs share.

In contact, runs of two engines part after some time, as two runs of C from starts that differ in
the last bit do. These figures of a run stay alike.
"""

import copy
from dataclasses import dataclass

import mujoco
import numpy as np

from mjbench.simulation import compat


@dataclass(frozen=True, eq=False)
class RunFigures:
    """Figures of states, evaluated by C.

    Attributes:
      penetration_m: (n,) depth of the deepest contact.
      violation: (n,) largest residual of an equality, or excess over a limit, in m or rad.
      force_n: (n,) normal forces of all contacts together.
      energy_j: (n,) potential and kinetic energy.
    """

    penetration_m: np.ndarray
    violation: np.ndarray
    force_n: np.ndarray
    energy_j: np.ndarray


def run_figures(model: mujoco.MjModel, states: np.ndarray) -> RunFigures:
    """Return the figures of (n, nstate) rows of mjSTATE_INTEGRATION; NaN if not finite."""
    with_energy = copy.copy(model)
    with_energy.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    data, rows = mujoco.MjData(model), np.full((len(states), 4), np.nan)
    for row, state in zip(rows, states, strict=True):
        if np.isfinite(state).all():
            compat.restart(with_energy, data, state)
            mujoco.mj_forward(with_energy, data)
            row[:] = (
                max([0.0, *(-c.dist for c in data.contact[: data.ncon])]),
                _violation(data),
                _normal_force(with_energy, data),
                data.energy.sum(),
            )
    return RunFigures(*rows.T)


def _violation(data: mujoco.MjData) -> float:
    limits = (
        int(mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT),
        int(mujoco.mjtConstraint.mjCNSTR_LIMIT_TENDON),
    )
    kind, residual = np.asarray(data.efc_type), np.asarray(data.efc_pos)
    equality = np.abs(residual[kind == int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)])
    return float(max(equality.max(initial=0.0), (-residual[np.isin(kind, limits)]).max(initial=0)))


def _normal_force(model: mujoco.MjModel, data: mujoco.MjData) -> float:
    force, total = np.zeros(6), 0.0
    for i in range(data.ncon):
        mujoco.mj_contactForce(model, data, i, force)
        total += force[0]
    return total
