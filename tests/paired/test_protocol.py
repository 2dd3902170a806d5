"""Launches: order of blocks, log ratios, cores, and processes."""

import os
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest
from paired_examples import CARTPOLE

from mjbench.instrument import machine
from mjbench.paired import protocol, time_limit
from mjbench.paired.process_pairs import ProcessPairs
from mjbench.paired.protocol import Launch, TargetPair
from mjbench.paired.worker_pool import WorkerPool

needs_affinity = pytest.mark.skipif(
    not hasattr(os, "sched_getaffinity"), reason="no affinity on this system"
)
LAUNCHES = 3


@dataclass
class Spied:
    """Launches of one pair, and what was seen of the processes while quads were timed."""

    allowed: set[int]
    launches: list[Launch] = field(default_factory=list)
    affinities: list[list[set[int]]] = field(default_factory=list)
    pids: list[tuple[int, int]] = field(default_factory=list)
    started_ahead: list[int] = field(default_factory=list)


@pytest.fixture(scope="module")
def spied(pool: WorkerPool) -> Iterator[Spied]:
    """Yield three launches of two identical targets."""
    has_affinity = hasattr(os, "sched_getaffinity")
    spied = Spied(os.sched_getaffinity(0) if has_affinity else set())
    time_quads = protocol.time_quads

    def spying(baseline: Any, candidate: Any, count: int) -> Any:
        spied.pids.append((baseline.pid, candidate.pid))
        spied.started_ahead.append(len(pair._pairs._next_pair))
        if has_affinity:
            pids = (0, baseline.pid, candidate.pid)
            spied.affinities.append([os.sched_getaffinity(pid) for pid in pids])
        return time_quads(baseline, candidate, count)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(protocol, "time_quads", spying)
        patch.setattr(protocol, "MAX_LAYOUTS", time_limit.LAYOUTS)
        pair = TargetPair(pool, CARTPOLE, CARTPOLE)
        spied.launches += [pair.launch() for _ in range(LAUNCHES)]
        pair.close()
    yield spied


@needs_affinity
def test_the_next_processes_start_on_other_cores_while_a_launch_is_measured(spied: Spied) -> None:
    expected = 2 if machine.usable_cores() > 1 else 0
    assert spied.started_ahead == [expected] * (LAUNCHES * time_limit.LAYOUTS)


def test_a_launch_takes_turns_in_balanced_quads(spied: Spied) -> None:
    for launch in spied.launches:
        assert set(launch.orders) <= {"ABBA", "BAAB"}
        assert launch.ns.shape == (len(launch.orders), 4)
        assert len(launch.orders) >= time_limit.LAYOUTS * time_limit.MIN_QUADS
        assert (launch.ns > 0).all()


@needs_affinity
def test_both_targets_run_on_the_core_of_this_process(spied: Spied) -> None:
    cores = [launch.core for launch in spied.launches for _ in range(time_limit.LAYOUTS)]
    assert spied.affinities == [[{core}] * 3 for core in cores]
    assert set(cores) <= spied.allowed
    assert os.sched_getaffinity(0) == spied.allowed


def test_every_launch_is_a_new_process(spied: Spied) -> None:
    assert len(spied.pids) == LAUNCHES * time_limit.LAYOUTS
    assert len({pid for pids in spied.pids for pid in pids}) == 2 * LAUNCHES


def test_a_launch_goes_on_while_the_next_processes_start(
    pool: WorkerPool, monkeypatch: pytest.MonkeyPatch
) -> None:
    answers = iter([False, False, True])
    monkeypatch.setattr(ProcessPairs, "is_next_ready", lambda pairs: next(answers))
    monkeypatch.setattr(protocol, "quad_count", lambda pair_s: time_limit.MIN_QUADS)
    pair = TargetPair(pool, CARTPOLE, CARTPOLE)
    launch = pair.launch()
    pair.close()
    assert len(launch.orders) == (time_limit.LAYOUTS + 2) * time_limit.MIN_QUADS


def test_a_launch_is_stored_with_its_raw_times(spied: Spied) -> None:
    launch = spied.launches[0]
    row = launch.row()
    assert (row.core, row.cores, row.orders) == (launch.core, None, launch.orders)
    assert row.ns == launch.ns.tolist()


def test_targets_with_threads_are_not_pinned_and_their_cores_are_counted(pool: WorkerPool) -> None:
    threaded = replace(CARTPOLE, path="rollout", options={"threads": 2})
    pair = TargetPair(pool, threaded, threaded)
    launch = pair.launch()
    pair.close()
    assert launch.core is None
    assert launch.cores is not None
    assert launch.cores > 0


def test_the_log_ratio_of_a_pair_is_candidate_over_baseline_whatever_the_order() -> None:
    ns = np.array([[100.0, 200.0, 200.0, 100.0], [200.0, 100.0, 100.0, 200.0]])
    launch = Launch(None, None, ["ABBA", "BAAB"], ns)
    assert np.exp(launch.pair_log_ratios()) == pytest.approx(np.full((2, 2), 2.0))


def test_the_baseline_time_is_that_of_its_blocks_alone() -> None:
    ns = np.array([[100.0, 900.0, 900.0, 110.0], [900.0, 120.0, 130.0, 900.0]])
    assert Launch(None, None, ["ABBA", "BAAB"], ns).baseline_ns == 115.0


def test_the_cost_of_coming_second_cancels_within_a_quad() -> None:
    second_is_slower = np.array([[100.0, 101.0, 100.0, 101.0]])
    launch = Launch(None, None, ["ABBA"], second_is_slower)
    assert launch.pair_log_ratios() == pytest.approx(np.log([[1.01, 1 / 1.01]]))
    assert launch.log_ratio == pytest.approx(0.0)


def test_drift_of_the_machine_cancels_within_a_quad() -> None:
    drifting = np.exp(np.array([[0.0, 0.1, 0.2, 0.3]]))
    assert Launch(None, None, ["BAAB"], drifting).log_ratio == pytest.approx(0.0)
