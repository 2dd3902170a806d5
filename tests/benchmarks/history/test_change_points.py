"""Change points, excursions and drifts of series that are given, and of simulated histories."""

import functools
import math

import numpy as np
import pytest

from benchmarks.history import change_points, release_ratios
from benchmarks.studies import history_simulation, simulated_histories
from benchmarks.studies.simulated_histories import PLANS, RELEASES, Plan, Score

SIGMA = 0.002
HISTORIES = 400


def changes(values: list[float]) -> change_points.Changes:
    """Return the changes of a series with a little noise that is always the same."""
    noise = SIGMA * np.random.default_rng(3).standard_normal(len(values))
    return change_points.changes(np.array(values) + noise, [SIGMA] * len(values))


def test_a_level_series_has_no_changes() -> None:
    assert changes([0.5] * 20) == change_points.Changes([], [], [])


def test_a_step_is_where_it_is_as_large_as_it_is() -> None:
    (step,) = changes([0.0] * 9 + [0.03] * 11).change_points
    assert (step.before, step.index) == (8, 9)
    assert step.change == pytest.approx(0.03, abs=3 * step.deviation)
    assert step.deviation == pytest.approx(SIGMA * math.sqrt(1 / 9 + 1 / 11))


def test_the_last_release_alone_can_be_a_step() -> None:
    (step,) = changes([0.0] * 19 + [-0.03]).change_points
    assert step.index == 19
    assert step.change < -0.02


def test_a_single_release_that_is_off_is_an_excursion_and_not_two_steps() -> None:
    result = changes([0.0] * 9 + [0.04] + [0.0] * 10)
    assert not result.change_points
    (excursion,) = result.excursions
    assert excursion.index == 9
    assert excursion.change == pytest.approx(0.04, abs=4 * SIGMA)


def test_a_step_right_after_an_excursion_is_from_the_release_before_it() -> None:
    result = changes([0.0] * 9 + [0.08] + [0.02] * 10)
    (step,) = result.change_points
    assert (step.before, step.index) == (8, 10)
    assert [excursion.index for excursion in result.excursions] == [9]


def test_a_regression_that_lasts_two_releases_is_a_step_and_the_way_back() -> None:
    up, down = changes([0.0] * 9 + [0.04] * 2 + [0.0] * 9).change_points
    assert (up.index, down.index) == (9, 11)
    assert up.change > 0.03 > -0.03 > down.change


def test_a_slow_change_is_a_drift_and_a_step_in_it_is_a_step() -> None:
    drift = [0.003 * i for i in range(20)]
    result = changes(drift)
    assert not result.change_points
    assert result.drifts[0].change == pytest.approx(0.057, abs=4 * SIGMA)
    (step,) = changes(drift[:10] + [value + 0.04 for value in drift[10:]]).change_points
    assert step.index == 10


def test_changes_below_the_smallest_are_not_listed() -> None:
    values = [0.0] * 10 + [0.008] * 10
    assert not changes(values).change_points
    sensitive = change_points.changes(values, [1e-4] * 20, min_change=0.005)
    assert [step.index for step in sensitive.change_points] == [10]


@pytest.mark.parametrize("deviations", [[1.0], [1.0, 0.0], [1.0, -1.0]])
def test_each_log_ratio_needs_a_positive_deviation(deviations: list[float]) -> None:
    with pytest.raises(ValueError, match="positive deviation"):
        change_points.changes([0.0, 0.0], deviations)


@functools.cache
def score_of(plan: Plan) -> Score:
    return simulated_histories.score(plan, HISTORIES)


@pytest.mark.parametrize("plan", PLANS, ids=lambda plan: plan.name)
def test_in_simulated_histories_change_points_are_detected_and_few_are_wrong(plan: Plan) -> None:
    score = score_of(plan)
    if plan.changes:
        assert score.false_discoveries <= change_points.FALSE_DISCOVERY_RATE
    else:
        assert score.wrong <= 0.1 * score.histories
    if plan.smallest >= 0.02 and plan.changes and plan.deviation is None:
        assert score.power >= 0.95
    if plan.drift:
        assert score.named >= 0.95 * score.drifts > 0


def test_steps_that_follow_each_other_are_no_drift() -> None:
    result = changes([0.0] * 8 + [-0.09, -0.10, -0.17, -0.18, -0.18])
    assert not result.drifts
    assert [point.index for point in result.change_points] == [8, 10]


@pytest.mark.parametrize(("between", "listed"), [(0.02, [8]), (0.011, [])])
def test_a_change_that_may_be_a_release_earlier_or_later_is_not_listed(
    between: float, listed: list[int]
) -> None:
    values = [0.0] * 8 + [between] + [0.02] * 7
    result = change_points.changes(values, [0.005] * len(values))
    assert [point.index for point in result.change_points] == listed


def test_where_nothing_happens_next_to_nothing_is_listed() -> None:
    assert score_of(PLANS[0]).wrong <= 1


def test_the_deviation_that_placement_adds_is_that_of_the_no_change_pairs() -> None:
    averaged, shipped = (
        np.sqrt(np.mean(simulated_histories.no_change_log_ratios(as_shipped) ** 2))
        for as_shipped in (False, True)
    )
    assert pytest.approx(shipped, abs=0.0005) == release_ratios.PLACEMENT_DEVIATION
    assert averaged > release_ratios.MIN_DEVIATION


def test_the_committed_page_is_of_a_thousand_histories_of_each_kind() -> None:
    text = history_simulation.PART.text()
    histories = f"{history_simulation.HISTORIES:,} histories of {RELEASES} releases"
    assert f"Each kind of noise has {histories}" in text
