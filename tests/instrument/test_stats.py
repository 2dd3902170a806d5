import numpy as np
import pytest

from mjbench.instrument import stats


def test_a_speedup_is_paired_within_rounds() -> None:
    drift = np.array([1.0, 1.5, 2.0, 0.7, 1.1, 3.0, 1.0])
    estimate = stats.speedup(list(2.0 * drift), list(drift))
    assert estimate.median == pytest.approx(2.0)
    assert estimate.low == pytest.approx(2.0)
    assert estimate.high == pytest.approx(2.0)


def test_too_few_rounds_have_no_interval() -> None:
    estimate = stats.speedup([1.0] * 5, [0.5] * 5)
    assert (estimate.median, estimate.low, estimate.high) == (pytest.approx(2.0), None, None)


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


def test_a_fixed_interval_computed_after_every_launch_is_wrong_more_often() -> None:
    """The tests above can fail: the usual t interval, computed again and again, is wrong."""
    from scipy import stats as scipy_stats

    rng, alarms = np.random.default_rng(0), 0
    for _ in range(400):
        x = rng.standard_normal(40)
        alarms += any(
            abs(x[:n].mean()) > scipy_stats.t.ppf(0.995, n - 1) * x[:n].std(ddof=1) / np.sqrt(n)
            for n in range(6, 41)
        )
    assert alarms / 400 > 0.03


def test_a_trimmed_mean_leaves_out_a_fifth_at_each_end() -> None:
    assert stats.trimmed_mean([100.0, 1.0, 2.0, 6.0, -50.0]) == pytest.approx(3.0)
    with pytest.raises(ValueError, match="need samples"):
        stats.trimmed_mean([])
