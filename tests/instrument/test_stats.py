from collections.abc import Callable, Sequence

import numpy as np
import pytest

from mjbench.instrument import stats
from mjbench.instrument.stats import Verdict


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


# The anytime-valid interval, and verdicts.


def decide(draw: Callable[[], float], most: int = 120) -> stats.Judgement:
    """Launch until there are enough launches, judging after each, as the command does."""
    values: list[float] = []
    while True:
        values.append(draw())
        judgement = stats.judge(values, min_effect=0.01, confidence=0.99, precision=0.005)
        if judgement.enough or len(values) == most:
            return judgement


def trials(
    truth: float, deviation: float, count: int, heavy: bool = False
) -> list[stats.Judgement]:
    """Decide `count` times; with heavy noise one launch in eight is disturbed."""
    rng = np.random.default_rng([abs(round(1e4 * truth)), round(1e4 * deviation), heavy])

    def draw() -> float:
        noise = rng.standard_normal() * (8 if heavy and rng.random() < 0.125 else 1)
        return float(np.log1p(truth) + deviation * noise)

    return [decide(draw) for _ in range(count)]


def share(judgements: Sequence[stats.Judgement], *verdicts: Verdict) -> float:
    return sum(j.verdict in verdicts for j in judgements) / len(judgements)


@pytest.mark.parametrize("heavy", [False, True])
@pytest.mark.parametrize("deviation", [0.004, 0.008, 0.015])
def test_identical_targets_are_called_different_at_most_once_in_a_hundred(
    deviation: float, heavy: bool
) -> None:
    judgements = trials(0.0, deviation, 1000, heavy)
    assert share(judgements, Verdict.SLOWER, Verdict.FASTER) <= 0.01


@pytest.mark.parametrize("deviation", [0.004, 0.006, 0.008])
def test_a_slowdown_of_1_percent_is_found_and_never_called_faster(deviation: float) -> None:
    judgements = trials(0.01, deviation, 400)
    assert share(judgements, Verdict.SLOWER) >= 0.95
    assert share(judgements, Verdict.FASTER) == 0


def test_intervals_contain_the_truth_although_computed_after_every_launch() -> None:
    for truth in (0.0, 0.005, 0.02, -0.02):
        judgements = trials(truth, 0.008, 500)
        covered = [j.low <= 1 + truth <= j.high for j in judgements]
        assert np.mean(covered) >= 0.985  # 99 % with 500 trials


def test_a_slowdown_well_below_the_smallest_effect_is_mostly_called_the_same() -> None:
    judgements = trials(0.003, 0.006, 400)
    assert share(judgements, Verdict.SAME) >= 0.9
    assert share(judgements, Verdict.FASTER) == 0


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


def test_the_interval_is_where_the_bayes_factor_reaches_its_bound(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(stats, "TRIM", 0.0)
    x = np.random.default_rng(1).normal(0.3, 1.0, 25)
    interval = stats.anytime_interval(list(x), 0.99)
    n, growth = len(x), 1 + len(x) * stats.PRIOR
    for end in (interval.low, interval.high):
        t2 = n * (x.mean() - end) ** 2 / x.var(ddof=1)
        factor = growth**-0.5 * ((1 + t2 / (n - 1)) / (1 + t2 / ((n - 1) * growth))) ** (n / 2)
        assert factor == pytest.approx(100)


def test_few_launches_give_no_verdict_however_clear() -> None:
    assert not stats.judge([0.5, 0.5001], 0.01, 0.99, 0.005).enough
    assert stats.judge([0.5, 0.5001] * 5, 0.01, 0.99, 0.005).verdict == Verdict.SLOWER


def test_launches_that_are_all_alike_are_judged() -> None:
    judgement = stats.judge([0.0] * 8, 0.01, 0.99, 0.005)
    assert (judgement.verdict, judgement.low, judgement.high) == (Verdict.SAME, 1.0, 1.0)


def test_no_launch_is_an_error() -> None:
    with pytest.raises(ValueError, match="need samples"):
        stats.anytime_interval([], 0.99)
