"""Does a run in contact do what C's does? Judged by figures that runs share after they part."""

from collections.abc import Mapping
from dataclasses import dataclass, fields

import mujoco
import numpy as np

from mjbench.paths.accelerated import Advance, start_fields
from mjbench.simulation import compat, trajectory
from mjbench.simulation.judgement import Measure, Precision, finite_or_none
from mjbench.simulation.run_figures import RunFigures, run_figures
from mjbench.simulation.trajectory import Trajectory
from mjbench.simulation.workload import Workload

# Points of a run at which its figures are compared, at most.
MAX_POINTS = 6
# Simulations whose figures are compared, at most.
MAX_SIMULATIONS = 16
# An engine may be this many times as far from C as the shadow, which rounds only states.
SHADOW_FACTOR = 10.0
# Differences below these shares of a figure's size are rounding.
_ROUNDING = {Precision.FLOAT64: 1e-8, Precision.FLOAT32: 1e-4}
# Where contacts differ, figures may differ by this share of their size, besides by as much as
# those of C's simulations differ from each other.
CLOSE_SHARE = 0.1

_NAMES = {
    "penetration_m": "penetration, m",
    "violation": "violation of constraints, m or rad",
    "force_n": "contact forces, N",
    "energy_j": "energy, J",
}

Fields = Mapping[str, np.ndarray]


@dataclass(frozen=True, eq=False)
class Points:
    """States of a run at some points of it.

    Attributes:
      step: (npoint,) steps before each point.
      states: (npoint, nsim, nstate), of the simulations that are followed.
    """

    step: np.ndarray
    states: np.ndarray


def run_points(workload: Workload, advance: Advance, reference: Trajectory) -> Points:
    """Return the states that the compiled program reaches at up to `MAX_POINTS` points of a run."""
    ends = 1 + trajectory.spread_indices(workload.ncontrol, MAX_POINTS)
    start, states, begin = start_fields(workload), [], 0
    for end in ends:
        control = np.roll(workload.control, -begin, axis=1)
        reached = dict(advance(start, control, int(end - begin) * workload.hold).fields)
        in_c = reference.states[:, end * workload.hold]
        states.append(_states(workload, in_c, reached, reference.simulation))
        start = {name: values for name, values in reached.items() if name != "ctrl"}
        begin = end
    return Points(ends * workload.hold, np.array(states))


def _states(
    workload: Workload, in_c: np.ndarray, reached: Fields, simulation: np.ndarray
) -> np.ndarray:
    """Return states with the fields that an engine has; others are those of C."""
    states = in_c.copy()
    for name, place in compat.state_columns(workload.model).items():
        if name in reached:
            states[:, place] = reached[name][simulation]
    return states


def figure_measures(
    model: mujoco.MjModel,
    points: Points,
    reference: Trajectory,
    shadow: Trajectory,
    precision: Precision,
    has_same_contacts: bool,
) -> list[Measure]:
    """Compare what a run comes to with C's, and with its float32 shadow's, from the same start.

    Args:
      has_same_contacts: whether the engine finds C's contacts. Then figures are held, state by
        state, to the shadow's; otherwise their means to the spread of C's simulations.
    """
    rows = trajectory.spread_indices(len(reference.simulation), MAX_SIMULATIONS)
    reached, in_c, in_shadow = (
        _figures(model, states)
        for states in (
            points.states[:, rows],
            reference.states[rows][:, points.step].swapaxes(0, 1),
            shadow.states[rows][:, points.step].swapaxes(0, 1),
        )
    )
    judge, measures = _as_shadow if has_same_contacts else _as_spread, []
    for figure in fields(RunFigures):
        own, expected, rounded = (getattr(each, figure.name) for each in (reached, in_c, in_shadow))
        measures.append(judge(_NAMES[figure.name], own, expected, rounded, precision))
    return measures


def _figures(model: mujoco.MjModel, states: np.ndarray) -> RunFigures:
    """Return figures, each (npoint, nsim)."""
    npoint, nsim, nstate = states.shape
    flat = run_figures(model, np.ascontiguousarray(states.reshape(-1, nstate)))
    return RunFigures(
        *(getattr(flat, each.name).reshape(npoint, nsim) for each in fields(RunFigures))
    )


def _as_shadow(
    name: str, reached: np.ndarray, in_c: np.ndarray, in_shadow: np.ndarray, precision: Precision
) -> Measure:
    """Compare a figure state by state; the shadow's mean difference says how far it may be."""
    size = float(np.sqrt(np.mean(in_c**2)))
    allowed = SHADOW_FACTOR * float(np.abs(in_shadow - in_c).mean()) + _ROUNDING[precision] * size
    return Measure(
        f"{name}: mean difference", finite_or_none(np.abs(reached - in_c).mean()), allowed
    )


def _as_spread(
    name: str, reached: np.ndarray, in_c: np.ndarray, in_shadow: np.ndarray, precision: Precision
) -> Measure:
    """Compare a figure's mean with C's; those of C's simulations say how far it may be."""
    size = float(in_c.std() if name == _NAMES["energy_j"] else np.sqrt(np.mean(in_c**2)))
    allowed = float(in_c.mean(axis=0).std()) + CLOSE_SHARE * size
    allowed += SHADOW_FACTOR * float(np.abs(in_shadow - in_c).mean())
    return Measure(
        f"{name}: difference of means", finite_or_none(abs(reached.mean() - in_c.mean())), allowed
    )
