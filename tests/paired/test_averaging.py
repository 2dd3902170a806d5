"""Whether a comparison averages over placements, and what its results say where it cannot."""

import itertools

import pytest
from paired_examples import INSTALLED

from mjbench.paired import averaging, moved_check
from mjbench.paired.averaging import Averaging
from mjbench.paired.worker_pool import WorkerPool
from mjbench.releases import movable
from mjbench.releases.installs import ReleaseSpec
from mjbench.releases.moved_image import ImmovableError
from mjbench.releases.placement import AS_SHIPPED


def test_launches_are_moved_or_as_shipped_where_nothing_can_be_moved() -> None:
    moved = itertools.islice(Averaging(True).placements(), 90)
    assert sum(pair.is_moved for pair in moved) == 80
    assert set(itertools.islice(Averaging(False).placements(), 100)) == {AS_SHIPPED}


def test_only_moved_launches_count_for_a_verdict() -> None:
    assert (Averaging(True).launches_with(6), Averaging(False).launches_with(6)) == (7, 6)


def test_both_releases_must_move(pool: WorkerPool, monkeypatch: pytest.MonkeyPatch) -> None:
    def check(pool: WorkerPool, release: object) -> None:
        if release is not INSTALLED:
            raise ImmovableError("it is a program")

    monkeypatch.setattr(moved_check, "check", check)
    other = ReleaseSpec("3.5.0", "3.5.0")
    assert averaging.averaging(pool, INSTALLED, INSTALLED) == Averaging(True)
    for pair in ((INSTALLED, other), (other, INSTALLED)):
        assert averaging.averaging(pool, *pair) == Averaging(
            False, "the code of MuJoCo 3.5.0 cannot be moved: it is a program"
        )


def test_elsewhere_than_on_linux_the_reason_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(movable.platform, "machine", lambda: "aarch64")
    with WorkerPool() as pool:
        averaged = averaging.averaging(pool, INSTALLED, INSTALLED)
    version = INSTALLED.version
    reason = "only libraries for Linux on x86-64 can be moved"
    problem = f"the code of MuJoCo {version} cannot be moved: {reason}"
    assert averaged == Averaging(False, problem)
