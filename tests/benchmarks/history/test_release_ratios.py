"""What the launches of a release say, as the history reads them."""

import math

import pytest

from benchmarks.history.release_ratios import (
    MAX_LAUNCHES,
    MIN_DEVIATION,
    PLACEMENT_DEVIATION,
    TARGET_S,
    TRUSTED_LAUNCHES,
    LaunchRatio,
    StepRatioRecord,
    are_enough,
    as_shipped,
    averaged,
    clipped,
    completed_share,
    finished,
)
from mjbench.releases.placement import Placement
from mjbench.status import Status


def moved(residue: int, log_ratio: float) -> LaunchRatio:
    return LaunchRatio(log_ratio, Placement(residue, residue))


def test_residues_weigh_the_same_and_launches_as_shipped_do_not_count() -> None:
    launches = [moved(0, x) for x in (0.10, 0.12, 0.11, 0.11)]
    launches += [moved(16, x) for x in (0.30, 0.32)]
    ratio = averaged([*launches, LaunchRatio(5.0)])
    assert ratio.log_ratio == pytest.approx((0.11 + 0.31) / 2)
    assert ratio.ratio == pytest.approx(math.exp(0.21))
    # pooled variance of four and of two launches, and the leverage of two unequal residues
    variance = (2e-4 + 2e-4) / 4 * (1 / 4 + 1 / 2) / 4
    assert ratio.deviation == pytest.approx(math.sqrt(variance))


def test_a_disturbed_launch_counts_for_no_more_than_one_that_is_far_off() -> None:
    calm = [moved(r, r / 100 + x) for r in (0, 16, 32, 48) for x in (-0.002, 0.0, 0.001, 0.002)]
    disturbed = [*calm[:-1], moved(48, 0.48 + 0.4)]
    usual, ratio = averaged(calm), averaged(disturbed)
    assert 0 < ratio.log_ratio - usual.log_ratio < 0.001
    assert clipped([0.0, 0.01, 0.02, 5.0, 5.01, 5.02], [0, 0, 0, 16, 16, 16])[3:] == [
        5.0,
        5.01,
        5.02,
    ]


def test_no_ratio_is_known_better_than_the_no_change_pairs_show() -> None:
    ratio = averaged([moved(residue, 0.2) for residue in (0, 16, 32, 48) * 4])
    assert ratio.deviation == MIN_DEVIATION


def test_where_nothing_was_moved_placement_adds_to_the_deviation() -> None:
    launches = [LaunchRatio(0.01), LaunchRatio(0.03)]
    shipped, ratio = as_shipped(launches), averaged(launches)
    assert ratio.log_ratio == shipped.log_ratio == pytest.approx(0.02)
    assert shipped.deviation == pytest.approx(0.01)
    assert ratio.deviation == pytest.approx(math.hypot(0.01, PLACEMENT_DEVIATION))


def test_two_launches_as_shipped_that_agree_by_chance_are_not_known_better_than_others() -> None:
    moved_ones = [moved(residue, x) for residue in (0, 16, 32, 48) for x in (-0.02, 0.02)]
    ratio = as_shipped([*moved_ones, LaunchRatio(0.1), LaunchRatio(0.1)])
    # eight squares of 0.02, five degrees of freedom, two launches
    assert ratio.deviation == pytest.approx(0.02 * math.sqrt(8 / 5 / 2))


def test_too_few_launches_say_nothing() -> None:
    assert averaged([]) is None
    assert averaged([moved(0, 0.1), moved(16, 0.1)]) is None
    assert as_shipped([moved(0, 0.1), LaunchRatio(0.1)]) is None


@pytest.mark.parametrize(("spread", "expected"), [(0.001, TRUSTED_LAUNCHES), (0.05, MAX_LAUNCHES)])
def test_noisy_launches_are_repeated_but_not_for_ever(spread: float, expected: int) -> None:
    block = [moved(residue, sign * spread) for residue in (0, 16, 32, 48) for sign in (-1, 1)]
    schedule = 10 * [*block, LaunchRatio(0.0)]
    assert next(n for n in range(91) if are_enough(schedule[:n], seconds=0.2 * n)) == expected


@pytest.mark.parametrize(
    ("launch_s", "expected"),
    [(TARGET_S / 36, 36), (TARGET_S / 35, 27), (TARGET_S / 26, 18), (TARGET_S, 18)],
)
def test_a_slow_machine_repeats_launches_only_while_time_is_left(
    launch_s: float, expected: int
) -> None:
    noisy = [moved(residue, sign * 0.05) for residue in (0, 16, 32, 48) for sign in (-1, 1)]
    schedule = 4 * [*noisy, LaunchRatio(0.0)]
    assert next(n for n in range(37) if are_enough(schedule[:n], n * launch_s)) == expected


@pytest.mark.parametrize(
    ("count", "seconds", "share"),
    [(0, 0.0, 0.0), (MAX_LAUNCHES // 2, 1.0, 0.5), (1, TARGET_S / 4, 0.25), (99, 999.0, 1.0)],
)
def test_launches_or_seconds_say_how_much_of_a_release_is_done(
    count: int, seconds: float, share: float
) -> None:
    assert completed_share(count, seconds) == share


def test_what_failed_is_measured_again() -> None:
    good, failed = (
        StepRatioRecord(
            model="pile", release="3.5.0", build="3.5.0", reference="4.0.0", status=status
        )
        for status in (Status.OK, Status.FAILED)
    )
    assert finished([good, failed, "another record"]) == [good]
