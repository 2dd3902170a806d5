"""What counts as agreement up to rounding, on made-up runs whose differences are known."""

import numpy as np
import pytest

from mjbench.simulation.rounding_reference import ReferenceRun, ReferenceSteps
from mjbench.web import rounding_check
from mjbench.web.rounding_check import RoundingCheck

COLUMNS = {"time": slice(0, 1), "qpos": slice(1, 3), "qvel": slice(3, 5)}
NSTEP, NBATCH = 20, 3


def run(shadow: float = 1e-13) -> ReferenceRun:
    rng = np.random.default_rng(0)
    states = rng.standard_normal((NSTEP + 1, NBATCH, 5))
    shadows = np.maximum.accumulate(np.linspace(0, shadow, NSTEP + 1))
    return ReferenceRun(COLUMNS, False, np.zeros((NBATCH, NSTEP, 1)), 1, states, 7, shadows)


def steps(n: int = 4) -> ReferenceSteps:
    states = np.random.default_rng(1).standard_normal((n, 5))
    constrained = np.arange(n) % 2 == 1
    return ReferenceSteps(states, np.zeros((n, 1)), states, constrained, np.full(n, 1e-16))


def check(
    states: np.ndarray, after: np.ndarray | None = None, same: np.ndarray | None = None
) -> RoundingCheck:
    return rounding_check.check(
        run(), steps(), states, steps().after if after is None else after, same
    )


def moved(step: int, by: float, column: int = 2, simulation: int = 1) -> np.ndarray:
    states = run().states.copy()
    states[step:, simulation, column] += by
    return states


def test_a_run_without_any_difference_is_identical() -> None:
    actual = check(run().states)
    assert actual.first is None
    assert [(point.step, point.difference) for point in actual.points] == [
        (0, 0.0), (1, 0.0), (10, 0.0), (20, 0.0)
    ]  # fmt: skip
    assert (actual.unconstrained.count, actual.constrained.count) == (2, 2)
    assert rounding_check.failures(actual) == []


def test_the_first_difference_is_named_and_allowed_while_it_is_rounding() -> None:
    actual = check(moved(5, 1e-15))
    assert actual.first is not None
    assert str(actual.first).startswith("after step 5, in qpos[1] of simulation 1, by ")
    assert actual.first.difference == pytest.approx(1e-15, rel=0.5)
    assert [point.difference > 0 for point in actual.points] == [False, False, True, True]
    assert rounding_check.failures(actual) == []


def test_a_difference_beyond_the_shadow_is_a_failure_from_its_first_step() -> None:
    actual = check(moved(12, 1e-8))
    assert actual.excess == 12
    (failure,) = rounding_check.failures(actual)
    assert "from step 12 on, the run differs by more than 10 times the shadow" in failure


def test_a_shadow_that_grows_allows_more() -> None:
    grown = rounding_check.check(run(1e-6), steps(), moved(20, 1e-6), steps().after, None)
    assert grown.excess is None
    assert check(moved(20, 1e-6)).excess == 20


def test_a_run_that_starts_elsewhere_is_a_failure_however_small() -> None:
    actual = check(moved(0, 1e-15))
    assert "it does not start where C does (after step 0" in rounding_check.failures(actual)[0]


def test_numbers_that_are_not_finite_are_a_failure() -> None:
    actual = check(moved(3, np.nan))
    assert actual.excess == 3
    assert actual.first is not None
    assert actual.first.difference > 0


@pytest.mark.parametrize(("row", "kind"), [(0, "an unconstrained step"), (1, "a constrained step")])
def test_a_single_step_that_differs_is_a_failure(row: int, kind: str) -> None:
    after = steps().after.copy()
    after[row, 3] += 1e-6
    (failure,) = rounding_check.failures(check(run().states, after))
    assert failure.startswith(kind)


def test_one_sensitive_step_of_the_shadow_does_not_excuse_all_others() -> None:
    sensitive = steps(20)
    sensitive.shadow[1] = 1e-3
    after = sensitive.after.copy()
    after[1, 3] += 1e-3
    assert not rounding_check.failures(
        rounding_check.check(run(), sensitive, run().states, after, None)
    )
    after[3::2, 3] += 1e-5
    actual = rounding_check.check(run(), sensitive, run().states, after, None)
    (failure,) = rounding_check.failures(actual)
    assert failure.startswith("a constrained step differs by 1.0e-05 in the median")


def test_it_is_told_whether_the_model_that_c_compiled_differs_too() -> None:
    assert not check(moved(5, 1e-15)).has_same_model
    alike = check(moved(5, 1e-15), same=run().states)
    assert alike.has_same_model and alike.first_of_same_model is None
    other = check(moved(5, 1e-15), same=moved(6, 1e-15))
    assert other.first_of_same_model is not None
    assert other.first_of_same_model.step == 6


def test_the_points_end_with_the_run() -> None:
    assert rounding_check.points(1) == [0, 1]
    assert rounding_check.points(100) == [0, 1, 10, 100]
    assert rounding_check.points(250) == [0, 1, 10, 100, 250]
