"""Does a run in contact do what C's does? Judged by figures that runs share after they part.

In contact, runs of two engines part after some time, as two runs of C from starts that differ in
the last bit do. These figures of a run stay alike.
"""

import copy
from dataclasses import dataclass

import mujoco
import numpy as np

from mjbench.commands.compare.accelerated_tolerances import (
    CLOSE_SHARE,
    FIGURE_ROUNDING,
    LARGEST_SHARE,
    MEAN_ERRORS,
    SHADOW_FACTOR,
    TOGETHER_SHARE,
)
from mjbench.paths.accelerated import Advance, start_fields
from mjbench.simulation import compat, reference_trajectory
from mjbench.simulation.accelerated_judgement import Measure, Precision, finite_or_none
from mjbench.simulation.reference_trajectory import Trajectory
from mjbench.simulation.workload import Workload

# Points of a run at which its figures are compared, at most.
MAX_POINTS = 6
# Simulations whose figures are compared, at most.
MAX_SIMULATIONS = 16
# Of the deepest contact; the largest residual of an equality, or excess over a limit; normal forces
# of all contacts together; potential and kinetic energy.
_ENERGY = "energy, J"
_FIGURES = ("penetration, m", "violation of constraints, m or rad", "contact forces, N", _ENERGY)


def _run_points(
    workload: Workload, advance: Advance, reference: Trajectory
) -> tuple[np.ndarray, np.ndarray]:
    """Return the (npoint,) steps before each point of a run, and (npoint, nsim, nstate) states."""
    ends = 1 + reference_trajectory.spread_indices(workload.ncontrol, MAX_POINTS)
    start, states, begin = start_fields(workload), [], 0
    for end in ends:
        control = np.roll(workload.control, -begin, axis=1)
        reached = dict(advance(start, control, int(end - begin) * workload.hold).fields)
        state = reference.states[:, end * workload.hold].copy()  # of fields that it does not have
        for name, place in compat.state_columns(workload.model).items():
            if name in reached:
                state[:, place] = reached[name][reference.simulation]
        states.append(state)
        start = {name: values for name, values in reached.items() if name != "ctrl"}
        begin = end
    return ends * workload.hold, np.array(states)


def figure_measures(
    workload: Workload,
    advance: Advance,
    reference: Trajectory,
    shadow: Trajectory,
    precision: Precision,
    has_same_contacts: bool,
) -> list[Measure]:
    """Compare what a run comes to with C's, and with its float32 shadow's, from the same start.

    Args:
      has_same_contacts: whether the engine finds C's contacts. Then figures are held to C's point
        by point before the shadow parts from C. After that, and otherwise, their means are held to
        the spread of C's simulations.
    """
    steps, reached_states = _run_points(workload, advance, reference)
    rows = reference_trajectory.spread_indices(len(reference.simulation), MAX_SIMULATIONS)
    c_states, shadow_states = (
        run.states[rows][:, steps].swapaxes(0, 1) for run in (reference, shadow)
    )
    rounded_states = reference_trajectory.as_float32(c_states)
    of_runs = [
        _figures(workload.model, states)
        for states in (reached_states[:, rows], c_states, rounded_states, shadow_states)
    ]
    measures = []
    for name, reached, in_c, rounded, in_shadow in zip(_FIGURES, *of_runs, strict=True):
        figure = RunFigure(name, reached, in_c, rounded, in_shadow, precision)
        measures += figure.measures(has_same_contacts)
    return measures


def _figures(model: mujoco.MjModel, states: np.ndarray) -> np.ndarray:
    """Return (4, npoint, nsim) figures, evaluated by C; NaN of states that are not finite."""
    with_energy = copy.copy(model)
    with_energy.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    data, figures = mujoco.MjData(model), np.full((len(_FIGURES), *states.shape[:2]), np.nan)
    for at in np.ndindex(*states.shape[:2]):
        if np.isfinite(states[at]).all():
            compat.restart(with_energy, data, np.ascontiguousarray(states[at]))
            mujoco.mj_forward(with_energy, data)
            figures[:, *at] = (
                penetration_m(data),
                violation(data),
                contact_force_n(with_energy, data),
                data.energy.sum(),
            )
    return figures


def penetration_m(data: mujoco.MjData) -> float:
    """Return how deep the deepest contact of a state is; 0 without contact."""
    return max(0.0, -float(np.min(data.contact.dist[: data.ncon], initial=0.0)))


def violation(data: mujoco.MjData) -> float:
    """Return the largest violation of an equality or a limit, in m or rad."""
    limits = (
        int(mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT),
        int(mujoco.mjtConstraint.mjCNSTR_LIMIT_TENDON),
    )
    kind, residual = data.efc_type[: data.nefc], data.efc_pos[: data.nefc]
    equality = np.abs(residual[kind == int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)])
    return float(max(equality.max(initial=0.0), (-residual[np.isin(kind, limits)]).max(initial=0)))


def contact_force_n(model: mujoco.MjModel, data: mujoco.MjData) -> float:
    """Return the sum of the normal forces of all contacts."""
    force, total = np.zeros(6), 0.0
    for i in range(data.ncon):
        mujoco.mj_contactForce(model, data, i, force)
        total += float(force[0])
    return total


@dataclass(frozen=True, eq=False)
class RunFigure:
    """A figure at points of a run, (npoint, nsim): of the engine, and of C.

    Attributes:
      rounded: of C's states, rounded to float32 once.
      in_shadow: of a run in which they are rounded before each step.
    """

    name: str
    reached: np.ndarray
    in_c: np.ndarray
    rounded: np.ndarray
    in_shadow: np.ndarray
    precision: Precision

    def measures(self, has_same_contacts: bool) -> list[Measure]:
        together = self._together() if has_same_contacts else np.zeros(self.in_c.shape, dtype=bool)
        measures = [self._before_parting(together)] if together.any() else []
        return measures if together.all() else [*measures, self._means()]

    def _together(self) -> np.ndarray:
        """Return where the shadow has not parted from C, and does not at the next point either."""
        parted = np.abs(self.in_shadow - self.in_c) > TOGETHER_SHARE * self._size + self._rounding
        parted = np.logical_or.accumulate(parted, axis=0)
        return np.asarray(~np.vstack([parted[1:], parted[-1:]]))

    def _before_parting(self, together: np.ndarray) -> Measure:
        differs = np.abs(self.in_shadow - self.in_c).mean()
        allowed = min(SHADOW_FACTOR * float(differs), CLOSE_SHARE * self._size) + self._rounding
        difference = np.abs(self.reached - self.in_c)[together].mean()
        return Measure(f"{self.name}: mean difference", finite_or_none(difference), allowed)

    def _means(self) -> Measure:
        """Compare means; shown alone where C's simulations differ too much to say what is wrong."""
        of_simulations = self.in_c.mean(axis=0)
        count, size = len(of_simulations), self._size
        spread = float(of_simulations.std(ddof=1)) if count > 1 else np.inf
        allowed = MEAN_ERRORS * np.sqrt(2 / count) * spread + CLOSE_SHARE * size + self._rounding
        if not self._is_energy:
            allowed = min(allowed, LARGEST_SHARE * size + self._rounding)
        is_known = spread <= max(size, self._rounding)
        difference = abs(self.reached.mean() - self.in_c.mean())
        name = f"{self.name}: difference of means"
        limit = float(allowed) if is_known else None
        return Measure(name, finite_or_none(difference), limit)

    @property
    def _is_energy(self) -> bool:
        return self.name == _ENERGY

    @property
    def _size(self) -> float:
        """The mean, or the standard deviation of an energy, whose zero is arbitrary."""
        return float(self.in_c.std() if self._is_energy else self.in_c.mean())

    @property
    def _rounding(self) -> float:
        """Differences that rounding makes: of the figure, and of the states that it is of."""
        share = FIGURE_ROUNDING[self.precision]
        of_states = SHADOW_FACTOR * float(np.abs(self.rounded - self.in_c).mean())
        of_states *= share / FIGURE_ROUNDING[Precision.FLOAT32]
        return share * float(np.sqrt(np.mean(self.in_c**2))) + of_states
