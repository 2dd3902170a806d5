import dataclasses

import numpy as np
import pytest

from mjbench.simulation import accelerated_limits, trajectory
from mjbench.simulation.accelerated_limits import AcceleratedCheck, Precision

# A check without a fault.
PASSED = AcceleratedCheck(
    precision=Precision.FLOAT64,
    received=True,
    still=False,
    unconstrained_steps=1,
    constrained_steps=1,
    contact_steps=1,
    unconstrained_error=1e-13,
    constrained_error=1e-3,
    contact_error=1e-2,
    unconstrained_nstep=3,
    unconstrained_difference=0.9e-10,
    unconstrained_shadow=1e-6,
    final_nstep=10,
    final_difference=0.5,
    final_shadow=0.25,
    final_shadow_median=0.1,
    lost=0,
)
WITHOUT_STEPS = dataclasses.replace(
    PASSED, unconstrained_error=None, constrained_error=None, contact_error=None
)


@pytest.mark.parametrize(
    ("precision", "shadow", "error", "difference", "passes"),
    [
        (Precision.FLOAT32, 1e-6, 1e-8, 9e-6, True),
        (Precision.FLOAT32, 1e-6, 1e-8, 1.1e-5, False),
        (Precision.FLOAT32, 1e-9, 2e-6, 1.9e-5, True),  # a small shadow, by chance
        (Precision.FLOAT32, 1e-9, 2e-6, 2.1e-5, False),
        (Precision.FLOAT64, 1e-6, 1e-13, 0.9e-10, True),
        (Precision.FLOAT64, 1e-6, 1e-13, 1.1e-10, False),
    ],
)
def test_an_unconstrained_run_is_held_to_the_shadow_or_to_single_steps(
    precision: Precision, shadow: float, error: float, difference: float, passes: bool
) -> None:
    check = dataclasses.replace(
        PASSED,
        precision=precision,
        unconstrained_error=error,
        unconstrained_shadow=shadow,
        unconstrained_difference=difference,
    )
    failed = accelerated_limits.failures(check)
    assert failed == [] if passes else "3 unconstrained steps differ" in failed[0]


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ({"received": False}, "does not have the start states"),
        ({"still": True}, "no step changes any state"),
        ({"lost": 2}, "2 simulations do not end in finite numbers"),
        ({"unconstrained_error": 1e-11}, "an unconstrained step differs by 1e-11"),
        ({"constrained_error": np.finfo(float).max}, "a constrained step does not end"),
        ({"contact_error": np.finfo(float).max}, "a step in contact does not end"),
    ],
)
def test_every_fault_is_reported_alone(fault: dict[str, float], message: str) -> None:
    (failed,) = accelerated_limits.failures(dataclasses.replace(PASSED, **fault))
    assert message in failed


def test_a_summary_lists_the_steps_of_each_kind() -> None:
    text = accelerated_limits.summary(dataclasses.replace(PASSED, same_count=1.0, contact_steps=2))
    assert text.startswith("single steps: 1 unconstrained within 1e-13, 1 constrained within 0.001")
    assert "2 in contact within 0.01, as many contacts as C in 100 % of those" in text
    assert "after 10 steps a difference of 0.5 (C with float32 states: 0.2)" in text


def test_float64_separates_precision_from_algorithm() -> None:
    coarse = dataclasses.replace(WITHOUT_STEPS, precision=Precision.FLOAT32, contact_error=1e-2)
    fine, same = (dataclasses.replace(WITHOUT_STEPS, contact_error=e) for e in (1e-9, 9e-3))
    assert accelerated_limits.error_cause(coarse, fine).startswith("precision")
    assert accelerated_limits.error_cause(coarse, same).startswith("algorithm")
    assert accelerated_limits.error_cause(coarse, WITHOUT_STEPS).startswith("unknown")


def test_contacts_of_two_engines_are_matched_by_geoms_and_nearest_normal() -> None:
    ours = trajectory.Contacts.of([0, 0], [[3, 1], [1, 3]], [[0, 0, -1], [0, 1, 0]])
    assert ours.geom.tolist() == [[1, 3], [1, 3]]
    assert ours.normal.tolist() == [[0, 0, 1], [0, 1, 0]]
    tilted = np.array([[0, np.sin(0.1), np.cos(0.1)]])
    theirs = trajectory.Contacts.of([0], [[1, 3]], tilted)
    assert accelerated_limits.normal_angle(ours, theirs) == pytest.approx(np.degrees(0.1))
    elsewhere = trajectory.Contacts.of([1], [[1, 3]], tilted)
    assert accelerated_limits.normal_angle(ours, elsewhere) is None
