import numpy as np
import pytest

from mjbench import agreement

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
