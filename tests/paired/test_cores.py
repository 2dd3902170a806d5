"""Which core a launch runs on."""

import os
import subprocess
import sys
from collections.abc import Iterable

import pytest
from paired_examples import CARTPOLE

from mjbench.host.topology import Topology
from mjbench.paired import cores
from mjbench.paired.target_pair import pair_of
from mjbench.paired.worker_pool import WorkerPool

pytestmark = pytest.mark.skipif(
    not hasattr(os, "sched_getaffinity"), reason="no affinity on this system"
)


def test_the_freest_core_is_one_of_ours_and_leaves_the_affinity_as_it_was() -> None:
    allowed = os.sched_getaffinity(0)
    assert cores.freest_core() in allowed
    assert os.sched_getaffinity(0) == allowed


def test_processes_start_on_other_cores_than_the_one_that_is_measured_on(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(cores, "USABLE", set(range(8)))
    monkeypatch.setattr(cores.topology, "siblings", lambda thread: {thread, (thread + 4) % 8})
    monkeypatch.setattr(cores.topology, "read", lambda usable: Topology(8, 4))
    assert cores.beside(0) == {1, 2, 3, 5, 6, 7}
    monkeypatch.setattr(cores.topology, "read", lambda usable: Topology(8, 4, quota_cores=3.5))
    assert cores.beside(0) == {1, 2}
    monkeypatch.setattr(cores, "USABLE", {0, 4})
    assert cores.beside(0) == {4}, "a hyper-thread, where nothing else is left"


def test_without_affinity_no_core_is_the_freest(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cores.platforms, "affinity", set)
    assert cores.freest_core() is None


def test_cores_are_tried_only_until_one_is_free(monkeypatch: pytest.MonkeyPatch) -> None:
    shares = {0: 0.5, 1: 1.0, 2: 0.99, 3: 1.0}
    tried: list[int] = []
    monkeypatch.setattr(cores.platforms, "affinity", lambda: set(shares))
    monkeypatch.setattr(cores.platforms, "set_affinity", lambda pid, chosen: None)
    monkeypatch.setattr(cores.random, "sample", lambda values, count: sorted(values)[:count])

    def share(core: int, probe_s: float) -> float:
        tried.append(core)
        return shares[core]

    monkeypatch.setattr(cores, "_share", share)
    assert cores.freest_core() == 1
    assert tried == [0, 1]
    shares.update({0: 0.4, 1: 0.6, 2: 0.7, 3: 0.5})
    assert cores.freest_core() == 2, "the least busy one, where none is free"


def test_cores_are_not_counted_where_there_is_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cores.machine, "usable_cores", lambda: 1)
    with WorkerPool() as pool:
        pair = pair_of(pool, (CARTPOLE, CARTPOLE))
        pair.nthread = 4
        assert pair._cores_had() == 1.0
        assert pool._processes == []


def test_pinning_ends_with_its_block_even_when_that_fails() -> None:
    allowed = os.sched_getaffinity(0)
    core = max(allowed)
    with pytest.raises(ZeroDivisionError), cores.pinned(core):
        assert os.sched_getaffinity(0) == {core}
        _ = 1 / 0
    assert os.sched_getaffinity(0) == allowed


def test_cores_that_are_taken_away_from_a_pinned_process_are_not_taken_back(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now = {0, 1}
    monkeypatch.setattr(cores.platforms, "affinity", lambda: set(now))
    monkeypatch.setattr(cores.platforms, "set_affinity", lambda _, allowed: replace(allowed))

    def replace(allowed: Iterable[int]) -> None:
        now.clear()
        now.update(allowed)

    with cores.pinned(0):
        replace({1})
    assert now == {1}


def test_confining_moves_a_process_and_passes_over_one_that_has_ended() -> None:
    core = max(os.sched_getaffinity(0))
    process = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    try:
        cores.confine([process.pid], {core})
        assert os.sched_getaffinity(process.pid) == {core}
    finally:
        process.communicate(b"\n")
    cores.confine([process.pid], {core})
