"""Histories of models, from records of their ratios to the reference."""

import math
from dataclasses import replace

import pytest
from speed_histories import operation_record, record

from benchmarks.history import speed_series
from benchmarks.history.release_ratios import StepRatioRecord
from mjbench.status import Status


def test_releases_are_in_the_order_of_their_versions_and_no_failures() -> None:
    records = [
        record("1.10", 1.0),
        record("1.2", 1.0),
        record("1.3", 1.0, status=Status.CRASHED),
        record("1.9", 1.0),
        record("2.1.0", 1.0),
        record("2.1.0.dev10", 1.0),
        record("my.2.0.5", 1.0),
        record("2.0.5", 1.0),
        record("1.2", 1.0, model="cloth"),
    ]
    pile, cloth = speed_series.histories(records)
    assert [each.release for each in pile.measured] == [
        "1.2",
        "1.9",
        "1.10",
        "2.0.5",
        "my.2.0.5",
        "2.1.0.dev10",
        "2.1.0",
    ]
    assert (cloth.name, len(cloth.measured)) == ("cloth", 1)


def test_launches_of_a_release_that_was_measured_again_add_up() -> None:
    first, again = record("1.0", 1.0), record("1.0", 1.2)
    failed = record("1.0", 1.5, status=Status.FAILED)
    (result,) = speed_series.histories([first, again, failed])
    (measured,) = result.measured
    assert measured.record.launches == [*first.launches, *again.launches]
    assert measured.ratio.ratio == pytest.approx(math.sqrt(1.2))


def test_launches_of_another_workload_or_build_do_not_add_up() -> None:
    first = record("1.0", 1.0)
    for again in (record("1.0", 1.2, workload="b"), replace(first, build="1.0-mine")):
        (result,) = speed_series.histories([first, again])
        (measured,) = result.measured
        assert measured.record is again


def work_changes(old: StepRatioRecord, new: StepRatioRecord) -> list[str]:
    (result,) = speed_series.histories([old, new])
    return speed_series.work_changes(*result.pair(1))


def test_work_is_compared_between_neighbours() -> None:
    old = record("1.0", 1.0, drift=0.3)
    assert work_changes(old, record("1.1", 1.0, drift=0.3)) == []
    assert work_changes(old, record("1.1", 1.0, drift=0.1)) == ["different result of one step"]
    assert work_changes(old, record("1.1", 1.0, drift=None)) == []
    more = work_changes(old, record("1.1", 1.0, contacts=1.0, drift=0.3))
    assert more[0] == "contacts 5 → 1"


def test_nothing_is_said_of_the_work_of_another_workload() -> None:
    old, new = record("1.0", 1.0), record("1.1", 1.0, workload="b", contacts=1.0)
    assert work_changes(old, new) == []
    (result,) = speed_series.histories([old, new])
    assert not speed_series.knows_work(*result.pair(1))


def test_simulations_that_diverge_in_one_release_only_are_other_work() -> None:
    # they are not timed, so that the workload is another one, too
    old, new = record("1.0", 1.0), replace(record("1.1", 1.0, workload="b"), diverged=2)
    assert work_changes(old, new) == ["2 simulations diverge instead of 0"]


def test_an_operation_with_another_result_does_other_work() -> None:
    old = operation_record("spec", "1.0", 1.0)
    new = replace(old, release="1.1", drift=0.5)
    (result,) = speed_series.histories([old, new])
    assert result.name == "spec"
    assert speed_series.work_changes(*result.pair(1)) == ["another result"]
    (unknown,) = speed_series.histories([old, replace(new, drift=None)])
    assert not speed_series.knows_work(*unknown.pair(1))
