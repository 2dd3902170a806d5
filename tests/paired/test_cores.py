"""Which core a launch runs on."""

import os
import subprocess
import sys

import pytest

from mjbench.instrument.topology import Topology
from mjbench.paired import cores

pytestmark = pytest.mark.skipif(
    not hasattr(os, "sched_getaffinity"), reason="no affinity on this system"
)


def test_the_freest_core_is_one_of_ours_and_leaves_the_affinity_as_it_was() -> None:
    allowed = os.sched_getaffinity(0)
    assert cores.freest_core() in allowed
    assert os.sched_getaffinity(0) == allowed


@pytest.mark.parametrize(
    ("cores_and_threads", "expected"),
    [
        (Topology(1, 1), 1),
        (Topology(2, 2), 1),
        (Topology(4, 2), 1),
        (Topology(4, 4, quota_cores=2.0), 1),
        (Topology(4, 4, quota_cores=3.5), 1),
        (Topology(4, None), 1),
        (Topology(4, 4), 2),
        (Topology(64, 32), 2),
    ],
    ids=[
        "one",
        "two",
        "hyper-threads of two",
        "a quota of two",
        "a quota below four",
        "unknown",
        "four",
        "many",
    ],
)
def test_two_launches_can_be_measured_at_the_same_time_where_each_has_a_core_to_spare(
    cores_and_threads: Topology, expected: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cores.topology, "read", lambda usable: cores_and_threads)
    assert cores.launches_at_once(most=2) == expected
    assert cores.launches_at_once() == 1


def test_processes_start_on_other_cores_than_those_that_are_measured_on(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(cores, "USABLE", set(range(8)))
    monkeypatch.setattr(cores.topology, "siblings", lambda thread: {thread, (thread + 4) % 8})
    monkeypatch.setattr(cores.topology, "read", lambda usable: Topology(8, 4))
    assert cores.beside([0, 1]) == {2, 3, 6, 7}
    assert cores.beside([0, 1, 2, 3]) == {4, 5, 6, 7}, "hyper-threads, where nothing else is left"
    monkeypatch.setattr(cores.topology, "read", lambda usable: Topology(8, 4, quota_cores=3.5))
    assert cores.beside([0, 1]) == {2}
    assert cores.beside([0, 1, 2]) == {3}


def test_without_affinity_launches_are_measured_one_by_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cores, "USABLE", set())
    assert cores.launches_at_once() == 1


def test_free_cores_are_no_hyper_threads_of_one_core(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cores.topology, "siblings", lambda thread: {thread, thread ^ 1})
    assert cores._on_different_cores([3, 0, 2, 1, 5]) == [3, 0, 5]
    monkeypatch.setattr(cores.topology, "siblings", lambda thread: frozenset())
    assert cores._on_different_cores([3, 0, 2]) == [3, 0, 2], "where the kernel does not say"


def test_as_many_free_cores_are_returned_as_are_asked_for() -> None:
    chosen = cores.freest_cores(2, probe_s=0.001)
    assert 1 <= len(chosen) <= 2
    assert len(set(chosen)) == len(chosen)
    assert set(chosen) <= os.sched_getaffinity(0)


def test_cores_are_tried_only_until_enough_are_free(monkeypatch: pytest.MonkeyPatch) -> None:
    shares = {0: 0.5, 1: 1.0, 2: 0.99, 3: 1.0}
    tried: list[int] = []
    monkeypatch.setattr(cores.platforms, "affinity", lambda: set(shares))
    monkeypatch.setattr(cores.platforms, "set_affinity", lambda pid, chosen: None)
    monkeypatch.setattr(cores.topology, "siblings", lambda thread: {thread})
    monkeypatch.setattr(cores.random, "sample", lambda values, count: sorted(values)[:count])

    def share(core: int, probe_s: float) -> float:
        tried.append(core)
        return shares[core]

    monkeypatch.setattr(cores, "_share", share)
    assert cores.freest_cores() == [1]
    assert tried == [0, 1]
    assert cores.freest_cores(2) == [1, 2]
    assert tried == [0, 1, 0, 1, 2]
    shares.update(dict.fromkeys(shares, 0.5))
    assert set(cores.freest_cores(4)) == set(shares), "equally busy ones, where none is free"


def test_pinning_ends_with_its_block_even_when_that_fails() -> None:
    allowed = os.sched_getaffinity(0)
    core = max(allowed)
    with pytest.raises(ZeroDivisionError), cores.pinned(core):
        assert os.sched_getaffinity(0) == {core}
        _ = 1 / 0
    assert os.sched_getaffinity(0) == allowed


def test_confining_moves_a_process_and_passes_over_one_that_has_ended() -> None:
    core = max(os.sched_getaffinity(0))
    process = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    try:
        cores.confine([process.pid], {core})
        assert os.sched_getaffinity(process.pid) == {core}
    finally:
        process.communicate(b"\n")
    cores.confine([process.pid], {core})
