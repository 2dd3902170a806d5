import numpy as np
import pytest

from mjbench.measuring import stats


def test_a_speedup_is_paired_within_rounds() -> None:
    drift = np.array([1.0, 1.5, 2.0, 0.7, 1.1, 3.0, 1.0])
    estimate = stats.speedup(list(2.0 * drift), list(drift))
    assert estimate.estimate == pytest.approx(2.0)
    assert estimate.low == pytest.approx(2.0)
    assert estimate.high == pytest.approx(2.0)


def test_too_few_rounds_have_no_interval() -> None:
    estimate = stats.speedup([1.0] * 5, [0.5] * 5)
    assert (estimate.estimate, estimate.low, estimate.high) == (pytest.approx(2.0), None, None)


def test_rounds_must_match() -> None:
    with pytest.raises(ValueError, match="same rounds"):
        stats.speedup([1.0, 2.0], [1.0])


def test_times_of_zero_have_finite_ratios() -> None:
    assert stats.pair_log_ratios(["ABBA"], np.zeros((1, 4))).tolist() == [[0.0, 0.0]]


@pytest.mark.parametrize("n", [7, 20])
def test_the_interval_covers_the_true_median_as_often_as_it_says(n: int) -> None:
    rng = np.random.default_rng(0)
    hits = 0
    for _ in range(1000):
        interval = stats.median_of(rng.standard_cauchy(n))  # heavy tails
        assert interval.low is not None
        assert interval.high is not None
        hits += interval.covers(0.0)
    assert hits >= 0.94 * 1000


def quads(ratios: np.ndarray, times: np.ndarray, second: float = 1.0) -> np.ndarray:
    """Return (quads, 4) times in the order ABBA: of A, times the ratios for B, 2nd ones slower."""
    return times[:, None] * np.stack(
        [np.ones_like(ratios), second * ratios, ratios, second * np.ones_like(ratios)], axis=1
    )


@pytest.mark.parametrize("second", [1.0, 1.05])
def test_a_slower_part_counts_by_the_time_that_it_takes(second: float) -> None:
    parts = np.tile(np.arange(10), 5)
    ratios = np.where(parts == 3, 1.5, 1.0)
    for times, expected in (
        (np.full(50, 100.0), (9 + 1.5) / 10),
        (np.where(parts == 3, 500.0, 100.0), (9 + 5 * 1.5) / 14),
    ):
        ns = quads(ratios, times, second)
        log_ratio = stats.total_log_ratio(["ABBA"] * 50, ns, parts)
        assert log_ratio == pytest.approx(np.log(expected))
        swapped = stats.total_log_ratio(["BAAB"] * 50, ns, parts)
        assert swapped == pytest.approx(-log_ratio)


def test_disturbed_blocks_of_a_part_are_left_out() -> None:
    rng = np.random.default_rng(1)
    parts = np.tile(np.arange(8), 25)
    ns = quads(np.full(200, 1.02), rng.uniform(50.0, 150.0, 8)[parts])
    is_disturbed = rng.random(ns.shape) < 0.1
    ns[is_disturbed] *= rng.uniform(1.0, 3.0, is_disturbed.sum())
    orders = ["ABBA"] * 200
    assert stats.total_log_ratio(orders, ns, parts) == pytest.approx(np.log(1.02))


def test_a_disturbed_block_does_not_change_the_weight_of_its_part() -> None:
    parts = np.tile(np.arange(2), 5)
    ns = quads(np.where(parts == 1, 4.0, 1.0), np.full(10, 100.0))
    ns[1, 0] = 1000.0
    assert stats.total_log_ratio(["ABBA"] * 10, ns, parts) == pytest.approx(np.log(5 / 2))


def test_work_in_one_part_has_the_ratio_of_its_quads() -> None:
    rng = np.random.default_rng(2)
    orders = ["ABBA" if is_abba else "BAAB" for is_abba in rng.random(41) < 0.5]
    is_candidate = np.array([[letter == "B" for letter in order] for order in orders])
    ns = rng.uniform(99.0, 101.0, (41, 4)) * np.where(is_candidate, 1.5, 1.0)
    whole = stats.total_log_ratio(orders, ns, np.zeros(41, dtype=int))
    assert whole == pytest.approx(np.log(1.5), abs=2e-3)
    assert whole == pytest.approx(stats.paired_log_ratio(orders, ns), abs=1e-3)
