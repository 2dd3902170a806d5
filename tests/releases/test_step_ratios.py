"""What the launches of a release say, as the history reads them."""

import math

import pytest

from mjbench.releases.placement import Placement
from mjbench.releases.step_ratios import MIN_DEVIATION, LaunchRatio, StepRatioRecord, finished
from mjbench.status import Status


def record(*launches: LaunchRatio, status: Status = Status.OK) -> StepRatioRecord:
    return StepRatioRecord(
        model="pile", release="3.5.0", build="3.5.0", reference="4.0.0", status=status,
        launches=launches,
    )  # fmt: skip


def moved(residue: int, log_ratio: float) -> LaunchRatio:
    return LaunchRatio(log_ratio, Placement(residue, residue))


def test_residues_weigh_the_same_and_launches_as_shipped_do_not_count() -> None:
    ratio = record(
        *(moved(0, x) for x in (0.10, 0.12, 0.11, 0.11)),
        *(moved(16, x) for x in (0.30, 0.32)),
        LaunchRatio(5.0),
    ).averaged()
    assert ratio is not None
    assert ratio.log_ratio == pytest.approx((0.11 + 0.31) / 2)
    assert ratio.ratio == pytest.approx(math.exp(0.21))
    # pooled variance of four and of two launches, and the leverage of two unequal residues
    variance = (2e-4 + 2e-4) / 4 * (1 / 4 + 1 / 2) / 4
    assert ratio.deviation == pytest.approx(math.sqrt(variance))


def test_no_ratio_is_known_better_than_the_no_change_pairs_show() -> None:
    ratio = record(*(moved(r, 0.2) for r in (0, 16, 32, 48) * 4)).averaged()
    assert ratio is not None
    assert ratio.deviation == MIN_DEVIATION


def test_where_nothing_was_moved_the_ratio_is_that_as_shipped() -> None:
    shipped = record(*map(LaunchRatio, (0.01, 0.03)))
    assert shipped.averaged() == shipped.as_shipped()
    assert shipped.as_shipped() is not None


def test_too_few_launches_say_nothing() -> None:
    assert record().averaged() is None
    assert record(moved(0, 0.1), moved(16, 0.1)).averaged() is None
    assert record(moved(0, 0.1), LaunchRatio(0.1)).as_shipped() is None


def test_what_failed_is_measured_again() -> None:
    good, failed = record(), record(status=Status.FAILED)
    assert finished([good, failed, "another record"]) == [good]
