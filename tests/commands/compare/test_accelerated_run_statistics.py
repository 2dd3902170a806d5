"""Figures of a run after it has parted from C's: what they excuse, and what they do not."""

import numpy as np
import pytest

from mjbench.commands.compare.accelerated_run_statistics import RunFigure
from mjbench.simulation.accelerated_judgement import Measure, Precision

NPOINT, NSIM = 6, 16
FORCE_N = "contact forces, N"


def forces(seed: int) -> np.ndarray:
    """Return forces of simulations that do alike on average."""
    return np.abs(np.random.default_rng(seed).normal(10.0, 4.0, (NPOINT, NSIM)))


def measures(
    reached: np.ndarray, shadow: np.ndarray, has_same_contacts: bool = True
) -> list[Measure]:
    figure = RunFigure(FORCE_N, reached, forces(0), forces(0), shadow, Precision.FLOAT32)
    return figure.measures(has_same_contacts)


def agree(reached: np.ndarray, shadow: np.ndarray, has_same_contacts: bool = True) -> bool:
    return all(each.is_within for each in measures(reached, shadow, has_same_contacts))


@pytest.mark.parametrize("has_same_contacts", [True, False])
@pytest.mark.parametrize("factor", [0.0, 5.0])
def test_no_force_and_five_times_the_force_fail_after_the_shadow_has_parted(
    factor: float, has_same_contacts: bool
) -> None:
    assert not agree(factor * forces(2), forces(1), has_same_contacts)


@pytest.mark.parametrize("seed", range(2, 12))
def test_a_run_that_has_parted_as_the_shadow_has_agrees(seed: int) -> None:
    assert agree(forces(seed), forces(1))


@pytest.mark.parametrize(("factor", "agrees"), [(1.0, True), (1.02, False)])
def test_a_run_is_held_to_c_point_by_point_before_the_shadow_parts(
    factor: float, agrees: bool
) -> None:
    shadow = forces(0) * (1 + 1e-4)
    assert agree(factor * shadow, shadow) == agrees


def test_points_after_the_shadow_has_parted_do_not_widen_the_limit_before() -> None:
    shadow, reached = forces(0) * (1 + 1e-4), forces(0)
    shadow[4:] = 5.0 * forces(1)[4:]
    reached[:3] *= 1.5
    assert not agree(reached, shadow)


def test_simulations_that_differ_too_much_from_each_other_are_shown_alone() -> None:
    in_c = np.zeros((NPOINT, NSIM))
    in_c[:, 0] = 100.0
    (measure,) = RunFigure(FORCE_N, 0 * in_c, in_c, in_c, in_c, Precision.FLOAT64).measures(False)
    assert measure.limit is None


def test_a_figure_that_is_less_than_float32_resolves_is_no_fault() -> None:
    in_c, noise = 1e-10 * forces(0), 1e-8 * forces(1)
    for precision, reached in ((Precision.FLOAT32, 1e-8 * forces(2)), (Precision.FLOAT64, in_c)):
        figure = RunFigure("violation", reached, in_c, noise, noise, precision)
        assert all(each.is_within for each in figure.measures(True))
