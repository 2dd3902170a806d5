from typing import Any

import numpy as np
import pytest

from mjbench.simulation import agreement, trajectory

COLUMNS = {"time": slice(0, 1), "qpos": slice(1, 3), "qvel": slice(3, 5)}


def states() -> np.ndarray:
    return np.arange(15.0).reshape(3, 5)


def test_equal_bits_agree() -> None:
    assert agreement.first_difference(states(), states(), COLUMNS) is None


def test_the_first_simulation_and_its_first_entry_are_named() -> None:
    got = states()
    got[2, 0] += 1
    got[1, 4] = np.nextafter(got[1, 4], 99)
    found = agreement.first_difference(got, states(), COLUMNS)
    assert found is not None
    assert (found.field, found.index, found.simulation) == ("qvel", 1, 1)
    assert "after step 7" in str(found.at(7))


def test_a_zero_of_the_other_sign_differs_and_the_same_nan_agrees() -> None:
    got, reference = states(), states()
    got[0, 1], reference[0, 1] = -0.0, 0.0
    assert agreement.first_difference(got, reference, COLUMNS) is not None
    got[0, 1] = reference[0, 1] = np.nan
    assert agreement.first_difference(got, reference, COLUMNS) is None


def test_entries_that_a_path_keeps_back_are_not_compared() -> None:
    got, held = states(), np.ones((3, 5), dtype=bool)
    got[0, 3], held[0, 3] = 99.0, False
    assert agreement.first_difference(got, states(), COLUMNS, held) is None


def test_a_state_that_was_never_written_is_told_as_such() -> None:
    got = states()
    got[0] = np.nan
    assert "never written" in str(agreement.first_difference(got, states(), COLUMNS))


def test_other_shapes_are_an_error() -> None:
    with pytest.raises(ValueError, match="shape"):
        agreement.first_difference(states()[:2], states(), COLUMNS)


def test_the_digest_sees_every_bit() -> None:
    other = states()
    other[2, 4] = np.nextafter(other[2, 4], 99)
    assert agreement.digest(states()) == agreement.digest(states()) != agreement.digest(other)


def check_of(precision: str, **strays: float) -> dict[str, Any]:
    kinds = ("free", "constrained", "contact")
    return {"precision": precision} | {f"{k}_stray": strays.get(k) for k in kinds}


@pytest.mark.parametrize(
    ("precision", "shadow", "stray", "difference", "passes"),
    [
        ("float32", 1e-6, 1e-8, 9e-6, True),
        ("float32", 1e-6, 1e-8, 1.1e-5, False),
        ("float32", 1e-9, 2e-6, 1.9e-5, True),  # a lucky shadow of one step
        ("float32", 1e-9, 2e-6, 2.1e-5, False),
        ("float64", 1e-6, 1e-13, 0.9e-10, True),
        ("float64", 1e-6, 1e-13, 1.1e-10, False),
    ],
)
def test_a_free_run_is_held_to_the_shadow_or_to_single_steps(
    precision: str, shadow: float, stray: float, difference: float, passes: bool
) -> None:
    run = {"received": True, "still": False, "lost": 0, "free_nstep": 3}
    strays = {"free_shadow": shadow, "free_difference": difference}
    found = agreement.failures(check_of(precision, free=stray) | run | strays)
    assert found == [] if passes else "3 free steps stray" in found[0]


def test_float64_tells_precision_from_algorithm() -> None:
    coarse = check_of("float32", contact=1e-2)
    assert agreement.cause(coarse, check_of("float64", contact=1e-9)).startswith("precision")
    assert agreement.cause(coarse, check_of("float64", contact=9e-3)).startswith("algorithm")


def test_contacts_of_two_engines_are_matched_by_geoms_and_nearest_normal() -> None:
    ours = trajectory.Contacts.of([0, 0], [[3, 1], [1, 3]], [[0, 0, -1], [0, 1, 0]])
    assert ours.geom.tolist() == [[1, 3], [1, 3]]
    assert ours.normal.tolist() == [[0, 0, 1], [0, 1, 0]]
    tilted = np.array([[0, np.sin(0.1), np.cos(0.1)]])
    theirs = trajectory.Contacts.of([0], [[1, 3]], tilted)
    assert agreement.normal_angle(ours, theirs) == pytest.approx(np.degrees(0.1))
    elsewhere = trajectory.Contacts.of([1], [[1, 3]], tilted)
    assert agreement.normal_angle(ours, elsewhere) is None
