import math

import pytest
from histories import counted, history, timed

from mjbench.releases.benchmark_names import BenchmarkName
from mjbench.releases.history import (
    Gap,
    GapReason,
    count_ratio,
    gaps,
    paired_change_points,
    unpaired_change_points,
    work_changes,
)


def test_a_change_point_is_found_at_its_release() -> None:
    (change_point,) = unpaired_change_points(history(timed(1.0, 1.01, 0.99, 1.2, 1.21, 1.19)))
    assert (change_point.previous, change_point.release) == ("1.2", "1.3")
    assert change_point.ratio == pytest.approx(1.2 / 0.99)


def test_a_time_that_falls_is_a_change_point_too() -> None:
    (change_point,) = unpaired_change_points(history(timed(1.0, 1.0, 0.8, 0.8, 0.8, 0.8)))
    assert change_point.ratio == pytest.approx(0.8)


@pytest.mark.parametrize(
    "values",
    [
        (1.0, 1.04, 1.0, 1.04, 1.0, 1.04),  # too small
        (1.0, 1.0, 1.3, 1.0, 1.0, 1.0),  # one odd release
        (1.0, 1.3, 1.0, 1.2, 1.2, 1.2),  # the releases before do not stand apart
        (1.0, 1.04, 1.08, 1.12, 1.16, 1.2),  # a slope, no single change above 5 %
    ],
)
def test_what_is_no_change_point(values: tuple[float, ...]) -> None:
    assert unpaired_change_points(history(timed(*values))) == []


def test_a_change_point_must_show_in_every_round() -> None:
    """The machine was slow for the whole of one round from 1.3 on."""
    values = (1.0, 1.0, 1.0, 1.1, 1.1, 1.1)
    rounds = [(1.0, 1.0)] * 3 + [(1.2, 1.0)] * 3
    assert unpaired_change_points(history(timed(*values, rounds=rounds))) == []


def test_releases_without_a_number_are_passed_over() -> None:
    (change_point,) = unpaired_change_points(history(timed(1.0, 1.0, math.nan, None, 1.5, 1.5)))
    assert (change_point.previous, change_point.release) == ("1.1", "1.4")


def test_the_ratio_is_that_of_the_faster_rounds() -> None:
    rounds = [(1.0, 1.0)] * 3 + [(1.2, 1.3)] * 3
    (change_point,) = unpaired_change_points(
        history(timed(1.0, 1.0, 1.0, 1.25, 1.25, 1.25, rounds=rounds))
    )
    assert change_point.ratio == pytest.approx(1.2)
    assert change_point.rounds == pytest.approx((1.2, 1.3))


def test_a_paired_change_needs_no_neighbours() -> None:
    ratios = counted(BenchmarkName.RATIO_TO_REFERENCE, 1.0, 1.02, 1.3, 1.0, math.nan, 0.9)
    times = timed(1.0, 1.0, 1.2, 1.0, 1.0, 0.9)
    change_points = paired_change_points(history(ratios, times))
    assert [(p.previous, p.release) for p in change_points] == [
        ("1.1", "1.2"),
        ("1.2", "1.3"),
        ("1.3", "1.5"),
    ]


def test_a_paired_change_that_no_unpaired_round_shows_is_no_change_point() -> None:
    ratios = counted(BenchmarkName.RATIO_TO_REFERENCE, 1.0, 1.0, 1.1, 1.1, 1.1, 1.1)
    times = timed(1.0, 1.0, 1.0, 1.0, 1.0, 1.0)
    assert paired_change_points(history(ratios, times)) == []


def test_changed_counters_are_described() -> None:
    measured = history(
        counted(BenchmarkName.CONTACTS, 1.0, 5.0),
        counted(BenchmarkName.CONSTRAINTS, 4.0, 4.0),
        counted(BenchmarkName.DRIFT, 1e-3, 1e-3),
    )
    assert work_changes(measured, "pole", "1.0", "1.1") == ["contacts 1 → 5"]


@pytest.mark.parametrize(
    ("drifts", "descriptions"),
    [
        ((0.0, 0.0), []),
        ((1e-15, 0.0), []),  # rounding
        ((1e-3, 0.0), ["different result of one step"]),
        ((1e-3, 2e-3), ["different result of one step"]),
    ],
)
def test_a_different_result_of_one_step_is_described(
    drifts: tuple[float, float], descriptions: list[str]
) -> None:
    assert (
        work_changes(history(counted(BenchmarkName.DRIFT, *drifts)), "pole", "1.0", "1.1")
        == descriptions
    )


def test_instructions_are_compared_where_both_releases_were_counted() -> None:
    measured = history(counted(BenchmarkName.INSTRUCTIONS, 10_000.0, 10_050.0, 11_100.0))
    ratio = count_ratio(measured, "pole", "1.1", "1.2")
    assert ratio == pytest.approx(1.10448, abs=1e-5)
    assert count_ratio(measured, "pole", "1.2", "1.3") is None


def test_gaps_say_which_releases_have_no_number_and_why() -> None:
    series = timed(1.0, math.nan, None, 1.0, math.nan, 1.0)
    assert gaps(history(series)) == [
        Gap("1000 × mj_step", "pole", ("1.1", "1.4"), GapReason.NOT_APPLICABLE),
        Gap("1000 × mj_step", "pole", ("1.2",), GapReason.FAILED),
    ]
