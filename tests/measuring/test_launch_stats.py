import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import integrate
from scipy.special import stdtrit

from mjbench.interval import Interval
from mjbench.measuring import launch_stats

RNG = np.random.default_rng(1)
NORMAL = RNG.normal(0.3, 1.0, 25)


RESIDUES = [0, 2, 1, 3, 3, 1, 0, 2] * 4


def bayes_factor(x: np.ndarray, mean: float) -> float:
    """Return the factor against a mean as Gönen and others state it, for one group."""
    n, growth = len(x), 1 + len(x) * launch_stats.PRIOR
    t2 = n * (x.mean() - mean) ** 2 / x.var(ddof=1)
    ratio = (1 + t2 / (n - 1)) / (1 + t2 / ((n - 1) * growth))
    return float(growth**-0.5 * ratio ** (n / 2))


def test_the_interval_is_where_the_bayes_factor_reaches_its_bound() -> None:
    interval = launch_stats.evidence(list(NORMAL), 0.99).interval
    assert interval.estimate == pytest.approx(NORMAL.mean())
    for end in (interval.low, interval.high):
        assert bayes_factor(NORMAL, end) == pytest.approx(100)


def test_the_e_value_is_the_bayes_factor_of_positive_means() -> None:
    """Integrate the likelihood over deviation and effect."""
    x = NORMAL[:12]

    def likelihood(effect: float) -> float:
        def of_log_deviation(s: float) -> float:
            squares = ((x - effect * math.exp(s)) ** 2).sum()
            return math.exp(-len(x) * s - squares / (2 * math.exp(2 * s)))

        return float(integrate.quad(of_log_deviation, -5, 5, limit=200)[0])

    def weighted(effect: float) -> float:
        density = math.exp(-(effect**2) / (2 * launch_stats.PRIOR))
        return 2 * likelihood(effect) * density / math.sqrt(2 * math.pi * launch_stats.PRIOR)

    expected = integrate.quad(weighted, 0, 8)[0] / likelihood(0.0)
    both = launch_stats.evidence(list(x), 0.99)
    assert both.e_positive == pytest.approx(expected, rel=1e-6)
    # the two halves of the prior
    assert (both.e_positive + both.e_negative) / 2 == pytest.approx(bayes_factor(x, 0.0))


def test_effects_of_residues_do_not_change_the_interval() -> None:
    residues = RESIDUES[:22]
    effects = np.array([0.0, -5.0, 40.0, 7.0])
    moved = [x + effects[r] for x, r in zip(NORMAL, residues, strict=False)]
    alone = launch_stats.evidence(list(NORMAL[:22]), 0.99, residues).interval
    interval = launch_stats.evidence(moved, 0.99, residues).interval
    assert interval.estimate - effects.mean() == pytest.approx(alone.estimate)
    assert interval.half_width == pytest.approx(alone.half_width)


def test_residues_weigh_the_same_however_many_launches_they_have() -> None:
    residues = [0] * 9 + [1] * 3
    samples = [1.0, 2.0, 3.0] * 3 + [11.0, 12.0, 13.0]
    assert launch_stats.evidence(samples, 0.99, residues).interval.estimate == pytest.approx(7.0)


def test_a_few_launches_beside_many_have_an_interval_around_their_own_mean() -> None:
    others = [float(x) for x in NORMAL[:20]]
    alone = launch_stats.evidence([7.0, 7.5], 0.99).interval
    beside = launch_stats.interval_beside([7.0, 7.5], 0.99, others, RESIDUES[:20])
    assert alone.high is None
    assert beside.estimate == 7.25
    # of two launches with the deviation of the others, and the degrees of freedom of both
    fitted = launch_stats.fit(np.array([[[7.0, 7.5]]]))
    more = launch_stats.fit(launch_stats.cells(others, RESIDUES[:20]))
    fitted = replace(
        fitted, freedom=fitted.freedom + more.freedom, squares=fitted.squares + more.squares
    )
    assert beside.half_width == pytest.approx(float(fitted.half_width(0.99)[0]))
    assert launch_stats.interval_beside([7.0, 7.5], 0.99, [], []) == alone


def test_a_disturbed_launch_is_left_out_once_there_are_enough_others() -> None:
    for count, left_out in ((10, 0), (20, 1)):
        samples = NORMAL[:count].copy()
        samples[3] += 30
        fitted = launch_stats.fit(samples[None, None, :])
        assert fitted.left_out[0] == left_out
        others = np.delete(samples, 3) if left_out else samples
        assert fitted.mean[0] == pytest.approx(others.mean())


def test_a_second_mode_is_not_left_out() -> None:
    samples = np.where(np.arange(20) % 4 == 0, 1.0, 0.0) + 0.01 * NORMAL[:20]
    assert launch_stats.fit(samples[None, None, :]).left_out[0] == 0


def test_no_residue_loses_so_many_launches_that_the_others_could_be_the_disturbed_ones() -> None:
    cells = NORMAL[:24].reshape(1, 4, 6).copy()
    cells[0, 2, 0] += 50
    assert launch_stats.fit(cells).left_out[0] == 1
    cells[0, 2, 1] += 50
    assert launch_stats.fit(cells).left_out[0] == 0


def test_any_number_of_launches_can_be_judged() -> None:
    assert (
        launch_stats.most_disturbed(10**9)
        == launch_stats.most_disturbed(launch_stats.MOST_LAUNCHES)
        > 400
    )


@pytest.mark.parametrize(("count", "most"), [(8, 0), (14, 0), (15, 1), (18, 1), (19, 2), (40, 9)])
def test_disturbed_launches_are_fewer_than_those_of_a_second_mode(count: int, most: int) -> None:
    assert launch_stats.most_disturbed(count) == most
    tail = sum(math.comb(count, k) for k in range(most + 1)) / 2**count
    assert 2 * tail <= launch_stats.SECOND_MODE or most == 0


def test_too_few_launches_have_no_interval_and_are_no_evidence() -> None:
    interval = launch_stats.evidence([0.1], 0.99).interval
    assert (interval.estimate, interval.low, interval.high) == (0.1, None, None)
    assert launch_stats.evidence([0.1], 0.99).e_positive == 1
    first = RESIDUES[:4]
    assert launch_stats.evidence([0.1, 0.1, 0.1, 0.1], 0.99, first).e_positive == 1
    assert launch_stats.evidence([0.1, 0.2, 0.1, 0.2], 0.99, first).interval.high is None


def test_launches_that_are_all_alike_have_an_interval_and_an_e_value() -> None:
    alike = launch_stats.evidence([0.0] * 8, 0.99)
    assert (alike.interval.low, alike.interval.high) == (0.0, 0.0)
    assert alike.e_positive == alike.e_negative == pytest.approx(9**-0.5)
    assert launch_stats.evidence([0.5] * 8, 0.99).e_positive > 100


def test_an_e_value_against_a_true_hypothesis_is_rarely_ever_large() -> None:
    """Whatever the residues do, and however long one launches."""
    effects = np.array([0.0, -5.0, 8.0, -3.0])
    cells = np.random.default_rng(0).standard_normal((2000, 4, 10)) + effects[:, None]
    largest = np.ones(2000)
    for images in range(2, 11):
        largest = np.maximum(largest, launch_stats.fit(cells[:, :, :images]).e_values()[0])
    assert np.mean(largest >= 20) <= 0.05
    assert np.mean(largest >= 100) <= 0.01


def test_what_cannot_be_judged_is_an_error() -> None:
    with pytest.raises(ValueError, match="need samples"):
        launch_stats.evidence([], 0.99)
    with pytest.raises(ValueError, match="need a confidence"):
        launch_stats.evidence([0.0, 1.0], 1.0)
    with pytest.raises(ValueError, match="shorter"):
        launch_stats.evidence([0.0, 1.0], 0.99, [0])


@pytest.mark.parametrize(
    ("e_values", "rejected"),
    [
        ([], ()),
        ([99.0], (False,)),
        ([100.0], (True,)),
        ([999.0] + [1.0] * 9, (False,) * 10),
        ([1000.0] + [1.0] * 9, (True,) + (False,) * 9),
        ([500.0, 1.0, 500.0, 1.0], (True, False, True, False)),
        ([100.0, 100.0, 100.0], (True, True, True)),  # all of them, though none alone would do
        ([150.0, 99.0, 150.0], (True, False, True)),
    ],
)
def test_e_values_of_a_family_are_rejected_together(
    e_values: list[float], rejected: tuple[bool, ...]
) -> None:
    assert launch_stats.e_benjamini_hochberg(e_values, 0.01) == rejected


def test_a_family_needs_a_level() -> None:
    with pytest.raises(ValueError, match="need a level"):
        launch_stats.e_benjamini_hochberg([1.0], 1.0)


def test_launches_beside_others_have_the_wider_of_their_spread_and_the_common_one() -> None:
    close, wide = [1.0, 1.01, 0.99, 1.0], [3.0, 5.0, 4.0, 4.0, 3.5]
    alone, beside = (launch_stats.student_interval(close, 0.95, others) for others in ((), wide))
    assert beside.estimate == alone.estimate
    assert beside.half_width > alone.half_width
    # a common spread that is narrower only adds degrees of freedom
    more = launch_stats.student_interval(wide, 0.95, close * 5)
    assert more.half_width == pytest.approx(
        launch_stats.student_interval(wide, 0.95).half_width
        * float(stdtrit(4 + 19, 0.975) / stdtrit(4, 0.975))
    )


def test_the_least_disturbed_launches_give_the_mean_and_all_of_them_the_range() -> None:
    samples = [2.0, 2.1, 1.9, 1.0, 0.9]
    interval = launch_stats.least_disturbed(samples, 3)
    assert (interval.low, interval.estimate, interval.high) == (0.9, pytest.approx(2.0), 2.1)
    assert launch_stats.least_disturbed(samples[:2], 3) == Interval(2.1, None, None)
