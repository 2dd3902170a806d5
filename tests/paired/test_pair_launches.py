"""Launches: order of blocks, log ratios, cores, and processes."""

import os
import random
import signal
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest
from paired_examples import BRIEF_SIZES, CARTPOLE, InventedPair

from mjbench.errors import Failure, MachineError
from mjbench.host import machine, platforms
from mjbench.host.child_connection import ChildError
from mjbench.paired import cores, launches, memory_layout, pair_launches, time_limit
from mjbench.paired.pair_launches import CountRule, ProcessPairs
from mjbench.paired.records import LaunchRow
from mjbench.paired.target_pair import pair_of
from mjbench.paired.time_limit import TimeLimit
from mjbench.paired.worker import Worker
from mjbench.paired.worker_pool import WorkerPool, WorkerProcess
from mjbench.releases.placement import AS_SHIPPED
from mjbench.releases.release_names import ReleaseSpec
from mjbench.status import Status

needs_affinity = pytest.mark.skipif(
    not hasattr(os, "sched_getaffinity"), reason="no affinity on this system"
)
LAUNCHES = 3


@dataclass
class Spied:
    """Launches of one pair, and what was seen of the processes while quads were timed."""

    allowed: set[int]
    launches: list[LaunchRow] = field(default_factory=list)
    affinities: list[list[set[int]]] = field(default_factory=list)
    pids: list[tuple[int, int]] = field(default_factory=list)
    started_ahead: list[bool] = field(default_factory=list)


@pytest.fixture(scope="module")
def spied(pool: WorkerPool) -> Iterator[Spied]:
    """Yield three launches of two identical targets."""
    has_affinity = hasattr(os, "sched_getaffinity")
    spied = Spied(os.sched_getaffinity(0) if has_affinity else set())
    time_quads = pair_launches.time_quads

    def spying(baseline: Any, candidate: Any, count: int) -> Any:
        spied.pids.append((baseline.pid, candidate.pid))
        spied.started_ahead.append(pair._next is not None)
        if has_affinity:
            pids = (0, baseline.pid, candidate.pid)
            spied.affinities.append([os.sched_getaffinity(pid) for pid in pids])
        return time_quads(baseline, candidate, count)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pair_launches, "time_quads", spying)
        patch.setattr(pair_launches, "MAX_LAYOUTS", time_limit.LAYOUTS)
        pair = pair_of(pool, (CARTPOLE, CARTPOLE), BRIEF_SIZES)
        pair.prepare()
        for _ in range(LAUNCHES):
            spied.launches.append(pair.launch())
        pair.close()
    yield spied


@needs_affinity
def test_the_next_processes_start_on_other_cores_while_a_launch_is_measured(spied: Spied) -> None:
    expected = machine.usable_cores() > 1
    assert spied.started_ahead == [expected] * (LAUNCHES * time_limit.LAYOUTS)


def test_a_launch_takes_turns_in_balanced_quads(spied: Spied) -> None:
    for launch in spied.launches:
        assert set(launch.orders) <= {"ABBA", "BAAB"}
        assert np.shape(launch.ns) == (len(launch.orders), 4)
        assert len(launch.orders) >= time_limit.LAYOUTS * time_limit.MIN_QUADS
        assert np.min(launch.ns) > 0


@needs_affinity
def test_both_targets_run_on_the_core_of_the_thread_that_measures(spied: Spied) -> None:
    chosen = [launch.core for launch in spied.launches for _ in range(time_limit.LAYOUTS)]
    assert spied.affinities == [[{core}] * 3 for core in chosen]
    assert set(chosen) <= spied.allowed
    assert os.sched_getaffinity(0) == spied.allowed


def test_every_launch_is_a_new_process(spied: Spied) -> None:
    assert len(spied.pids) == LAUNCHES * time_limit.LAYOUTS
    assert len({pid for pids in spied.pids for pid in pids}) == 2 * LAUNCHES


def test_a_launch_goes_on_while_the_next_processes_start(
    pool: WorkerPool, monkeypatch: pytest.MonkeyPatch
) -> None:
    answers = iter([False, False, True])
    monkeypatch.setattr(ProcessPairs, "is_next_ready", lambda pairs: next(answers))
    monkeypatch.setattr(pair_launches, "quad_count", lambda all_blocks_s, nsection: nsection)
    pair = pair_of(pool, (CARTPOLE, CARTPOLE), BRIEF_SIZES)
    pair.prepare()
    launch = pair.launch()
    pair.close()
    assert launch.layouts == [launch.nsection] * (time_limit.LAYOUTS + 2)


def test_an_interrupt_ends_what_is_measured(
    pool: WorkerPool, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(baseline: Any, candidate: Any, count: int) -> Any:
        baseline.ask(Worker.time_blocks)  # it waits for a block to run, and is asked for none
        raise KeyboardInterrupt

    monkeypatch.setattr(pair_launches, "time_quads", interrupt)
    before, allowed = list(pool._processes), platforms.affinity()
    pair = pair_of(pool, (CARTPOLE, CARTPOLE), BRIEF_SIZES)
    pair.prepare()
    with pytest.raises(KeyboardInterrupt):
        pair.launch()
    pair.close()
    assert pool._processes == before
    assert platforms.affinity() == allowed


@needs_affinity
def test_a_process_that_fails_while_it_starts_does_not_end_the_launch_before(
    pool: WorkerPool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if machine.usable_cores() < 2:
        pytest.skip("one core: nothing starts ahead")
    pair = pair_of(pool, (CARTPOLE, CARTPOLE), BRIEF_SIZES)
    pair.prepare()
    time_quads = pair_launches.time_quads

    def kill_next(baseline: Any, candidate: Any, count: int) -> Any:
        ahead = pair._next
        os.kill(ahead.processes[0].pid, signal.SIGKILL)
        return time_quads(baseline, candidate, count)

    monkeypatch.setattr(pair_launches, "time_quads", kill_next)
    pair.launch()
    with pytest.raises(ChildError, match=r"baseline .*killed by signal 9"):
        pair.launch()
    pair.close()


@pytest.mark.skipif(not platforms.can_adopt(), reason="only Linux adopts orphans")
def test_programs_of_other_seeds_start_with_the_last_launch_of_those_before(
    pool: WorkerPool, monkeypatch: pytest.MonkeyPatch
) -> None:
    launches = memory_layout.launches_of_a_program()
    seeds = memory_layout.schedule(random.Random(), launches)
    early, started, start = list[tuple[int, int]](), list[WorkerProcess](), pool.start

    def spying(*arguments: Any) -> WorkerProcess:
        started.append(start(*arguments))
        return started[-1]

    def start_early(release: ReleaseSpec, side: int, *arguments: object) -> None:
        early.append((side, len(started)))

    release = CARTPOLE.release
    with monkeypatch.context() as patch:
        patch.setattr(pool, "seeds", lambda releases: seeds)
        patch.setattr(pool, "start", spying)
        patch.setattr(pool, "start_program_early", start_early)
        pairs = ProcessPairs(pool, (release, release), ("baseline", "candidate"))
        pairs.start()
        for _ in range(launches):
            with pairs.launched(None):
                pass
            pairs.wait()
        pairs.end_all()
    # in random order, and none again for the first launch of those programs
    assert sorted(early) == [(0, 2 * launches), (1, 2 * launches)]


@needs_affinity
@pytest.mark.parametrize("is_alone", [False, True])
def test_the_processes_of_a_launch_end_while_the_next_start(
    pool: WorkerPool, monkeypatch: pytest.MonkeyPatch, is_alone: bool
) -> None:
    """Where a launch has the whole machine, they end before that."""
    if machine.usable_cores() < 2:
        pytest.skip("one core")
    core = None if is_alone else min(cores.USABLE)
    end, ended = pool.end, list[WorkerProcess]()

    def spying(processes: Sequence[WorkerProcess]) -> None:
        ended.extend(processes)
        end(processes)

    release = CARTPOLE.release
    with monkeypatch.context() as patch:
        patch.setattr(pool, "end", spying)
        pairs = ProcessPairs(pool, (release, release), ("baseline", "candidate"))
        pairs.start()
        with pairs.launched(core) as first:
            assert ended == []
        assert ended == ([*first.processes] if is_alone else [])
        pairs.wait()
        with pairs.launched(core) as second:
            assert ended == [*first.processes]
        pairs.end_all()
    assert ended[:4] == [*first.processes, *second.processes]


def test_comparisons_of_the_same_releases_share_their_programs(pool: WorkerPool) -> None:
    first, second = CARTPOLE.release, ReleaseSpec("3.5.0", "3.5.0")
    assert pool.seeds((first, second)) is pool.seeds((first, second))
    assert pool.seeds((first, second)) is not pool.seeds((second, first))


def test_where_one_process_of_a_launch_cannot_start_the_other_ends(
    pool: WorkerPool, monkeypatch: pytest.MonkeyPatch
) -> None:
    start, started = pool.start, list[Any]()

    def start_one(*arguments: Any) -> Any:
        if started:
            raise MachineError("no process is left")
        started.append(start(*arguments))
        return started[-1]

    monkeypatch.setattr(pool, "start", start_one)
    release = CARTPOLE.release
    before = list(pool._processes)
    with pytest.raises(MachineError, match="no process is left"):
        ProcessPairs(pool, (release, release), ("baseline", "candidate")).start()
    assert len(started) == 1
    assert pool._processes == before


def test_targets_with_threads_are_not_pinned_and_their_cores_are_counted(pool: WorkerPool) -> None:
    threaded = replace(CARTPOLE, path="rollout", options={"threads": 2})
    pair = pair_of(pool, (threaded, threaded), BRIEF_SIZES)
    pair.prepare()
    launch = pair.launch()
    pair.close()
    assert launch.core is None
    assert launch.cores is not None
    assert launch.cores > 0


# When launches end: nothing is launched.


class FourAnswer(CountRule):
    """Four launches have an answer."""

    @property
    def has_answer(self) -> bool:
        return len(self.launches) >= 4


def launched(count: int, limit_s: float = 1e9) -> tuple[int, Failure]:
    """Launch a number of times, a second each; return how often, and how it ended."""
    clock = [0.0]

    def invent() -> LaunchRow:
        clock[0] += 1.0
        return LaunchRow(0, None, ["ABBA"], [[1, 1, 1, 1]], AS_SHIPPED, [1])

    limit = TimeLimit(limit_s, 4, clock=lambda: clock[0], purpose="a test")
    rule = FourAnswer(limit, count)
    ending = launches.launch(InventedPair(limit, invent), rule)
    return len(rule.launches), ending


def test_launches_go_on_while_there_is_time() -> None:
    assert launched(5) == (5, Failure(Status.OK, ""))


def test_launches_end_with_the_time_limit_and_what_they_gave() -> None:
    assert launched(50, limit_s=10.0) == (10, Failure(Status.OK, ""))


def test_a_time_limit_that_allows_no_answer_is_explained() -> None:
    count, ending = launched(50, limit_s=2.0)
    assert (count, ending.status) == (2, Status.OK)
    assert "a test needs at least 4 launches, 5 s in all: give a longer --budget" in ending.detail
