"""What a time limit allows, on a clock that only the test moves."""

import math

import pytest
from still_clock import StillClock

from mjbench.paired import time_limit
from mjbench.paired.time_limit import (
    BRIEF_S,
    LAYOUTS,
    LONG_LAYOUTS,
    OutOfTimeError,
    TimeLimit,
    launch_s,
    layout_count,
    quad_count,
)


@pytest.fixture
def clock() -> StillClock:
    return StillClock(1000.0)


@pytest.mark.parametrize(
    ("all_blocks_s", "quads", "seconds"),
    [
        (2e-3, 10, 0.22),  # blocks of a millisecond
        (1e-5, 100, 0.0101),
        (2.0, 2, 36.0),  # blocks of a second
    ],
)
def test_a_launch_takes_as_long_as_its_blocks(
    all_blocks_s: float, quads: int, seconds: float
) -> None:
    assert quad_count(all_blocks_s * (1 - 1e-9)) == quads
    assert launch_s(all_blocks_s * (1 - 1e-9)) == pytest.approx(seconds)


def test_a_launch_of_long_blocks_has_fewer_layouts() -> None:
    assert layout_count(0.0099) == LAYOUTS
    assert layout_count(0.0101) == LONG_LAYOUTS


def test_a_launch_that_would_exceed_the_limit_is_refused_with_the_time_that_it_needs(
    clock: StillClock,
) -> None:
    limit = TimeLimit(2.0, min_launches=6, clock=clock)
    limit.start()
    with pytest.raises(OutOfTimeError) as caught:
        limit.check_first_launch(launch_s=36.0, preparation_s=48.0)
    assert str(caught.value) == (
        "a launch takes about 36 s, and a verdict needs at least 6 launches, 330 s in all:"
        " give a longer --budget"
    )
    TimeLimit(330.0, 6, clock).check_first_launch(36.0, 48.0)


def test_what_was_spent_before_counts(clock: StillClock) -> None:
    limit = TimeLimit(60.0, min_launches=6, clock=clock)
    limit.start()
    limit.check_first_launch(launch_s=40.0, preparation_s=15.0)
    clock.now += 10.0
    with pytest.raises(OutOfTimeError):
        limit.check_first_launch(launch_s=40.0, preparation_s=15.0)


def test_a_brief_launch_is_made_whatever_the_limit(clock: StillClock) -> None:
    limit = TimeLimit(0.1, min_launches=6, clock=clock)
    limit.start()
    clock.now += 5.0
    limit.check_first_launch(launch_s=BRIEF_S)


def test_launches_go_on_while_another_fits(clock: StillClock) -> None:
    limit = TimeLimit(60.0, min_launches=2, clock=clock)
    limit.start()
    clock.now += 50.0
    assert limit.allows_another(launches=8, before_s=2.0, can_judge=True)  # 6 s each
    clock.now += 6.0
    assert not limit.allows_another(launches=9, before_s=2.0, can_judge=True)


def test_time_that_ends_before_there_are_enough_launches_is_said(clock: StillClock) -> None:
    limit = TimeLimit(0.1, min_launches=6, clock=clock)
    limit.start()
    clock.now += 0.75
    with pytest.raises(OutOfTimeError, match="4 s in all: give a longer --budget"):
        limit.allows_another(launches=1, before_s=0.35, can_judge=False)


def test_a_limit_that_counts_loading_begins_at_once(clock: StillClock) -> None:
    limit = TimeLimit(60.0, 6, clock, counts_loading=True)
    clock.now += 20.0
    limit.start()
    assert limit.spent_s() == 20.0


def test_without_a_limit_nothing_is_refused() -> None:
    limit = TimeLimit()
    limit.check_first_launch(launch_s=1e9)
    limit.start()
    limit.check_first_launch(launch_s=1e9)
    assert limit.allows_another(launches=1, before_s=0.0, can_judge=False)


@pytest.mark.parametrize(
    ("seconds", "expected"), [(0.2, 1), (7.01, 8), (99.5, 100), (101, 110), (1234, 1300)]
)
def test_a_suggested_limit_is_never_too_short(seconds: float, expected: int) -> None:
    assert time_limit._rounded_up(seconds) == expected
    assert expected >= math.ceil(seconds)
