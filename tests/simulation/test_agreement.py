import numpy as np
import pytest

from mjbench.simulation import agreement

COLUMNS = {"time": slice(0, 1), "qpos": slice(1, 3), "qvel": slice(3, 5)}


def states() -> np.ndarray:
    return np.arange(15.0).reshape(3, 5)


def test_equal_bits_agree() -> None:
    assert agreement.first_differing_entry(states(), states(), COLUMNS) is None


def test_a_difference_is_the_first_entry_of_the_first_simulation() -> None:
    got = states()
    got[2, 0] += 1
    got[1, 4] = np.nextafter(got[1, 4], 99)
    difference = agreement.first_differing_entry(got, states(), COLUMNS)
    assert (difference.field, difference.index, difference.simulation) == ("qvel", 1, 1)
    assert "after step 7" in str(difference.at(7))


def test_a_zero_of_the_other_sign_differs_and_the_same_nan_agrees() -> None:
    got, reference = states(), states()
    got[0, 1], reference[0, 1] = -0.0, 0.0
    assert agreement.first_differing_entry(got, reference, COLUMNS) is not None
    got[0, 1] = reference[0, 1] = np.nan
    assert agreement.first_differing_entry(got, reference, COLUMNS) is None


def test_entries_that_a_path_does_not_return_are_not_compared() -> None:
    got, mask = states(), np.ones((3, 5), dtype=bool)
    got[0, 3], mask[0, 3] = 99.0, False
    assert agreement.first_differing_entry(got, states(), COLUMNS, mask) is None


def test_a_state_that_was_never_written_is_reported_as_such() -> None:
    got = states()
    got[0] = np.nan
    assert "never written" in str(agreement.first_differing_entry(got, states(), COLUMNS))


def test_other_shapes_are_an_error() -> None:
    with pytest.raises(ValueError, match="shape"):
        agreement.first_differing_entry(states()[:2], states(), COLUMNS)


def test_a_relative_error_counts_what_is_not_finite_as_the_largest_number() -> None:
    want = {"qpos": np.array([[1.0, 200.0], [0.5, 0.0], [0.0, 0.0]])}
    got = {"qpos": np.array([[2.0, 200.0], [0.75, 0.0], [np.nan, 0.0]])}
    errors = agreement.max_relative_error(got, want, ("qpos", "qvel"))
    assert errors.tolist() == [1 / 200, 0.25, np.finfo(float).max]
