"""A release against the reference, as the history measures it."""

import itertools

import pytest
from paired_examples import CARTPOLE, INSTALLED

from mjbench.errors import MachineError
from mjbench.paired import step_ratio
from mjbench.paired.protocol import TargetPair
from mjbench.paired.worker_pool import WorkerPool
from mjbench.releases import release_ratios
from mjbench.status import Status


def test_a_release_against_itself_does_the_same_work_in_as_many_launches_as_are_enough(
    pool: WorkerPool, monkeypatch: pytest.MonkeyPatch
) -> None:
    counts: list[int] = []
    clock = itertools.count(10.0).__next__
    enough = iter([False, False, True, True])
    monkeypatch.setattr(release_ratios, "are_enough", lambda launches, seconds: next(enough))
    record = step_ratio.measure(pool, CARTPOLE, CARTPOLE, counts.append, clock)
    again = step_ratio.measure(pool, CARTPOLE, CARTPOLE)
    assert (record.status, record.model, record.release) == (
        Status.OK,
        "cartpole",
        INSTALLED.version,
    )
    assert counts == [1, 2]
    assert len(record.launches) == 2
    assert record.work == record.reference_work
    assert record.drift == 0.0
    assert record.seconds == 5.0  # the clock was read six times
    assert record.reference_s is not None
    assert record.workload == again.workload != ""
    if not record.problem:
        assert record.launches[0].placement is not None


def test_what_was_measured_before_a_failure_is_kept(
    pool: WorkerPool, monkeypatch: pytest.MonkeyPatch
) -> None:
    launch = TargetPair.launch
    launches = iter([launch])

    def fail_later(pair: TargetPair) -> object:
        try:
            return next(launches)(pair)
        except StopIteration:
            raise MachineError("out of luck") from None

    monkeypatch.setattr(TargetPair, "launch", fail_later)
    record = step_ratio.measure(pool, CARTPOLE, CARTPOLE)
    assert (record.status, record.detail) == (Status.FAILED, "out of luck")
    assert len(record.launches) == 1


def test_the_time_of_a_step_is_that_of_the_median_block_by_its_steps() -> None:
    assert step_ratio._step_s([9e6, 2e6, 1e6], steps=1000) == pytest.approx(2e-6)
    assert step_ratio._step_s([], steps=1000) is None
