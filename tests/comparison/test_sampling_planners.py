"""What planners do with costs that are known."""

import numpy as np
import pytest

from mjbench.comparison.sampling_planners import Algorithm, Planner, PlannerSettings

LOW, HIGH = np.array([-1.0, 0.0]), np.array([1.0, 4.0])


def planner(algorithm: Algorithm, **settings: float) -> Planner:
    chosen = PlannerSettings(algorithm, samples=200, knots=4, **settings)  # type: ignore[arg-type]
    return Planner(chosen, np.array([0.0, 9.0]), LOW, HIGH)


@pytest.mark.parametrize("algorithm", list(Algorithm))
def test_every_algorithm_finds_the_cheapest_controls(algorithm: Algorithm) -> None:
    own, goal = planner(algorithm), np.array([0.5, 1.0])
    for _ in range(40):
        candidates = own.candidates()
        own.improve(candidates, ((candidates - goal) ** 2).sum(axis=(1, 2)))
    np.testing.assert_allclose(own.nominal, np.tile(goal, (4, 1)), atol=0.25)


def test_candidates_keep_to_the_range_and_the_first_is_the_nominal_one() -> None:
    own = planner(Algorithm.MPPI)
    candidates = own.candidates()
    assert candidates.shape == (200, 4, 2)
    assert (candidates >= LOW).all()
    assert (candidates <= HIGH).all()
    np.testing.assert_array_equal(candidates[0], own.nominal)
    np.testing.assert_array_equal(own.nominal[0], [0.0, 4.0])


def test_predictive_sampling_takes_the_cheapest_candidate() -> None:
    own = planner(Algorithm.PREDICTIVE_SAMPLING)
    candidates, costs = own.candidates(), np.ones(200)
    costs[17] = 0.0
    own.improve(candidates, costs)
    np.testing.assert_array_equal(own.nominal, candidates[17])


def test_mppi_takes_the_weighted_mean_of_the_paper() -> None:
    own = planner(Algorithm.MPPI, temperature=0.5)
    candidates, costs = own.candidates(), np.linspace(0.0, 1.0, 200)
    own.improve(candidates, costs)
    weights = np.exp(-costs / (0.5 * costs.std()))
    expected = (candidates * (weights / weights.sum())[:, None, None]).sum(axis=0)
    np.testing.assert_allclose(own.nominal, expected, rtol=1e-12)


def test_cem_takes_the_mean_of_the_elites() -> None:
    own = planner(Algorithm.CEM, elites=0.05)
    candidates, costs = own.candidates(), np.arange(200.0)
    own.improve(candidates, costs)
    np.testing.assert_allclose(own.nominal, candidates[:10].mean(axis=0))


@pytest.mark.parametrize("algorithm", list(Algorithm))
def test_a_candidate_that_diverges_counts_as_the_worst(algorithm: Algorithm) -> None:
    own = planner(algorithm)
    candidates, costs = own.candidates(), np.arange(200.0)
    costs[:3] = np.nan, np.inf, -np.inf
    own.improve(candidates, costs)
    assert np.isfinite(own.nominal).all()


def test_a_plan_advances_by_one_control() -> None:
    own = planner(Algorithm.MPPI)
    own.nominal = np.arange(8.0).reshape(4, 2)
    np.testing.assert_array_equal(own.advance(), [0.0, 1.0])
    np.testing.assert_array_equal(own.nominal, [[2, 3], [4, 5], [6, 7], [6, 7]])


@pytest.mark.parametrize("algorithm", list(Algorithm))
def test_the_same_costs_give_the_same_plan_to_the_last_bit(algorithm: Algorithm) -> None:
    plans = []
    for _ in range(2):
        own = planner(algorithm)
        for _ in range(3):
            candidates = own.candidates()
            own.improve(candidates, np.abs(candidates).sum(axis=(1, 2)))
            own.advance()
        plans.append(own.nominal)
    np.testing.assert_array_equal(*plans)
