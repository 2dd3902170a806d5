import numpy as np
import pytest

from mjbench import stats


def test_a_speedup_is_paired_within_rounds() -> None:
    drift = np.array([1.0, 1.5, 2.0, 0.7, 1.1, 3.0, 1.0])
    found = stats.speedup(list(2.0 * drift), list(drift))
    assert found.median == pytest.approx(2.0)
    assert found.low == pytest.approx(2.0)
    assert found.high == pytest.approx(2.0)


def test_too_few_rounds_have_no_interval() -> None:
    found = stats.speedup([1.0] * 5, [0.5] * 5)
    assert (found.median, found.low, found.high) == (pytest.approx(2.0), None, None)


def test_rounds_must_match() -> None:
    with pytest.raises(ValueError, match="same rounds"):
        stats.speedup([1.0, 2.0], [1.0])


@pytest.mark.parametrize("n", [7, 20])
def test_the_interval_covers_the_true_median_as_often_as_it_says(n: int) -> None:
    rng = np.random.default_rng(0)
    hits = 0
    for _ in range(1000):
        low, high = stats.median_interval(rng.standard_cauchy(n))  # heavy tails
        assert low is not None
        assert high is not None
        hits += low <= 0.0 <= high
    assert hits >= 0.94 * 1000
