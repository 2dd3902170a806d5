"""A release against the reference, as the history measures it."""

import contextlib
import itertools
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
import pytest
from paired_examples import CARTPOLE, INSTALLED

from benchmarks import operations
from benchmarks.history import release_ratios, timing
from benchmarks.history.release_ratios import (
    LaunchRatio,
    OperationRatioRecord,
    RatioRecord,
    StepRatioRecord,
)
from benchmarks.history.tasks import OperationTask, ReleaseTask, StepTask
from mjbench.errors import InputError
from mjbench.host.child_connection import ChildError
from mjbench.measuring import stats
from mjbench.paired import moved_check
from mjbench.paired.moved_check import PlacementControl
from mjbench.paired.pair_launches import ProcessPair
from mjbench.paired.records import section_numbers
from mjbench.paired.target_pair import StepPair
from mjbench.paired.worker import Worker
from mjbench.paired.worker_pool import WorkerPool
from mjbench.releases.placement import AS_SHIPPED
from mjbench.releases.release_names import ReleaseSpec
from mjbench.status import Status

BOTH = INSTALLED, INSTALLED
SPEC = operations.registry()["spec"]


def enough_after(monkeypatch: pytest.MonkeyPatch, count: int) -> None:
    monkeypatch.setattr(
        release_ratios, "are_enough", lambda launches, seconds: len(launches) >= count
    )


def test_a_release_against_itself_does_the_same_in_launches_that_tasks_share(
    pool: WorkerPool, monkeypatch: pytest.MonkeyPatch
) -> None:
    enough_after(monkeypatch, 2)
    launches: list[tuple[int, float]] = []
    clock = itertools.count(10.0).__next__
    tasks = [StepTask(BOTH, CARTPOLE.model), OperationTask(BOTH, SPEC)]

    def on_launch(index: int, share: float) -> None:
        launches.append((index, share))

    ((step, spec),) = timing.measure_each(pool, [tasks], on_launch, clock)
    assert launches == [(0, release_ratios.completed_share(1, 1.0)), (0, 1.0)]
    assert isinstance(step, StepRatioRecord)
    assert isinstance(spec, OperationRatioRecord)
    for record in (step, spec):
        assert (record.status, record.release) == (Status.OK, INSTALLED.version)
        assert len(record.launches) == 2
        assert record.drift == 0.0
        assert record.reference_s is not None
        if not record.problem:
            assert record.launches[0].placement is not None
    # the clock was read at the begin, before and after each launch, and at the end
    assert step.seconds == spec.seconds == 5.0 / 2
    assert step.work == step.reference_work is not None
    assert (step.series, spec.series) == ("cartpole", "spec")
    again = StepTask(BOTH, CARTPOLE.model)
    (same,) = timing.measure(pool, [again])
    assert isinstance(same, StepRatioRecord)
    assert same.workload == step.workload != ""


class InventedTask(ReleaseTask):
    """A task that calls a function instead of timing anything."""

    record_type = "invented"

    def __init__(self, name: str, ready: Callable[[int], Sequence[int]]):
        super().__init__(BOTH)
        self.name, self._ready, self.closed = name, ready, False

    @property
    def series(self) -> str:
        return self.name

    def prepare(self, pool: WorkerPool) -> None:
        if self.name == "impossible":
            raise InputError("there is no such thing")

    def lay_out(self, pair: ProcessPair) -> Sequence[int]:
        return self._ready(len(self.launches))

    def record(self, problem: str, seconds: float) -> RatioRecord:
        return self._common(self.name, problem, seconds)

    def close(self) -> None:
        self.closed = True


class IdlePairs:
    """Stands for the processes of launches, of which invented tasks ask nothing."""

    def __init__(self, *arguments: object): ...

    def start(self, placements: object) -> None: ...

    def wait(self) -> None: ...

    @contextlib.contextmanager
    def launched(self, core: int | None) -> Iterator[ProcessPair]:
        nobody: Any = None
        yield ProcessPair((nobody, nobody), AS_SHIPPED)

    def is_next_ready(self) -> bool:
        return True

    def end_all(self) -> None: ...


@pytest.fixture
def no_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have no process start and no block run: both take a millisecond."""
    monkeypatch.setattr(timing, "ProcessPairs", IdlePairs)
    monkeypatch.setattr(
        timing, "time_quads", lambda old, new, count: (["ABBA"] * count, np.full((count, 4), 1e6))
    )
    monkeypatch.setattr(moved_check, "placement_control", lambda *releases: PlacementControl(False))


def fine(count: int) -> Sequence[int]:
    return 10**6, 10**6


@pytest.mark.usefixtures("no_blocks")
def test_a_task_that_fails_says_so_and_the_others_go_on(
    pool: WorkerPool, monkeypatch: pytest.MonkeyPatch
) -> None:
    enough_after(monkeypatch, 3)

    def crash_later(count: int) -> Sequence[int]:
        if count == 1:
            raise ChildError(Status.FAILED, "it fell over")
        return fine(count)

    def refuse(count: int) -> Sequence[int]:
        raise InputError("not in this release")

    tasks = [
        InventedTask("good", fine),
        InventedTask("impossible", fine),
        InventedTask("crashing", crash_later),
        InventedTask("refused", refuse),
    ]
    good, impossible, crashing, refused = timing.measure(pool, tasks)
    assert (good.status, len(good.launches)) == (Status.OK, 3)
    assert (impossible.status, impossible.detail) == (Status.INPUT, "there is no such thing")
    assert (crashing.status, crashing.detail) == (Status.FAILED, "it fell over")
    assert len(crashing.launches) == 1
    assert (refused.status, refused.launches) == (Status.INPUT, [])
    assert all(task.closed for task in tasks)


@pytest.mark.usefixtures("no_blocks")
def test_a_fixed_number_of_launches_is_neither_more_nor_less(pool: WorkerPool) -> None:
    tasks = [InventedTask("first", fine), InventedTask("second", fine)]
    records = timing.measure(pool, tasks, launches=3)
    assert [len(record.launches) for record in records] == [3, 3]


@pytest.mark.usefixtures("no_blocks")
def test_ctrl_c_ends_tasks_that_are_not_complete_and_what_was_measured_stays(
    pool: WorkerPool, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt_later(count: int) -> Sequence[int]:
        if count == 2:
            raise KeyboardInterrupt
        return fine(count)

    last = LaunchRatio(0.5)
    monkeypatch.setattr(release_ratios, "are_enough", lambda launches, seconds: last in launches)
    complete = InventedTask("complete", fine)
    complete.launches.append(last)
    tasks = [InventedTask("interrupted", interrupt_later), complete]
    records = timing.measure(pool, tasks)
    assert [r.status for r in records] == [Status.INTERRUPTED, Status.OK]
    assert [len(r.launches) for r in records] == [2, 2]


def test_releases_take_turns_until_each_is_known_well_enough(
    pool: WorkerPool, monkeypatch: pytest.MonkeyPatch, no_blocks: None
) -> None:
    """A release that needs no more than one turn is stored while the other goes on."""
    monkeypatch.setattr(release_ratios, "SCHEDULE_LAUNCHES", 2)
    counts = {"brief": 2, "long": 5}
    timed: list[str] = []
    last: dict[str, int] = {}

    def ready(name: str) -> Callable[[int], Sequence[int]]:
        def record(count: int) -> Sequence[int]:
            if count != last.get(name):
                timed.append(name)
            last[name] = count
            return fine(count)

        return record

    tasks = {name: InventedTask(name, ready(name)) for name in counts}

    def are_enough(launches: Sequence[LaunchRatio], seconds: float) -> bool:
        (task,) = (task for task in tasks.values() if task.launches is launches)
        return len(launches) >= counts[task.name]

    monkeypatch.setattr(release_ratios, "are_enough", are_enough)
    measured = timing.measure_each(pool, [[task] for task in tasks.values()])
    names = []
    for (record,) in measured:
        names.append(record.model)
        assert record.status == Status.OK
        assert len(record.launches) == counts[record.model]
        assert tasks[record.model].closed
    assert names == ["brief", "long"]
    assert timed[:4] in (["brief", "brief", "long", "long"], ["long", "long", "brief", "brief"])
    assert timed[4:] == ["long"] * 3


@pytest.mark.usefixtures("no_blocks")
def test_ctrl_c_ends_all_releases_that_take_turns_and_begins_no_others(
    pool: WorkerPool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(release_ratios, "SCHEDULE_LAUNCHES", 2)
    enough_after(monkeypatch, 100)
    monkeypatch.setattr(timing, "_MAX_IN_TURNS", 2)

    def interrupt_later(count: int) -> Sequence[int]:
        if count == 3:
            raise KeyboardInterrupt
        return fine(count)

    ready = (interrupt_later, interrupt_later, fine, fine)
    tasks = [InventedTask(str(i), each) for i, each in enumerate(ready)]
    records = [r for (r,) in timing.measure_each(pool, [[task] for task in tasks])]
    assert {r.model for r in records} == {"0", "1"}
    assert {r.status for r in records} == {Status.INTERRUPTED}
    assert sorted(len(r.launches) for r in records) in ([2, 3], [3, 4])
    assert not tasks[2].launches


@pytest.mark.usefixtures("no_blocks")
def test_ctrl_c_after_the_last_launch_is_not_lost(
    pool: WorkerPool, monkeypatch: pytest.MonkeyPatch
) -> None:
    enough_after(monkeypatch, 1)

    def interrupted(pairs: IdlePairs) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(IdlePairs, "end_all", interrupted)
    measured = timing.measure_each(pool, [[InventedTask("good", fine)]])
    ((record,),) = itertools.islice(measured, 1)
    assert record.status == Status.OK
    with pytest.raises(KeyboardInterrupt):
        next(measured)


def test_nothing_to_measure_gives_nothing(pool: WorkerPool) -> None:
    assert list(timing.measure_each(pool, [])) == []


@pytest.mark.usefixtures("no_blocks")
def test_a_disturbed_block_does_not_decide_how_many_are_timed(
    pool: WorkerPool, monkeypatch: pytest.MonkeyPatch
) -> None:
    counts: list[int] = []

    def count_quads(all_blocks_s: float, nsection: int, layout_s: float) -> int:
        counts.append(round(1e3 * all_blocks_s))
        return 6

    monkeypatch.setattr(timing, "quad_count", count_quads)
    enough_after(monkeypatch, 2)
    times = iter([(2 * 10**6, 10**6), (10**6, 10**6), *[(50 * 10**6, 10**6)] * 9])
    timing.measure(pool, [InventedTask("good", lambda count: next(times))])
    assert counts[:3] == [3, 2, 2]
    assert set(counts[2:]) == {2}


@pytest.mark.usefixtures("no_blocks")
@pytest.mark.parametrize(("tasks", "layouts"), [(1, 4), (2, 2)])
def test_a_task_that_is_alone_is_timed_until_the_next_processes_are_ready(
    pool: WorkerPool, monkeypatch: pytest.MonkeyPatch, tasks: int, layouts: int
) -> None:
    answers = iter([False, False, *[True] * 9])
    monkeypatch.setattr(IdlePairs, "is_next_ready", lambda pairs: next(answers))
    enough_after(monkeypatch, 1)
    prepared: list[str] = []

    def ready(name: str) -> Callable[[int], Sequence[int]]:
        def record(count: int) -> Sequence[int]:
            prepared.append(name)
            return fine(count)

        return record

    names = [str(i) for i in range(tasks)]
    timing.measure(pool, [InventedTask(name, ready(name)) for name in names])
    assert [prepared.count(name) for name in names] == tasks * [layouts]


@pytest.mark.usefixtures("no_blocks")
def test_a_task_that_is_alone_does_not_wait_for_ever(
    pool: WorkerPool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(IdlePairs, "is_next_ready", lambda pairs: False)
    enough_after(monkeypatch, 1)
    ready = itertools.count()
    timing.measure(pool, [InventedTask("alone", lambda count: fine(next(ready)))])
    assert next(ready) == timing._MAX_LAYOUTS


@pytest.mark.parametrize(
    ("reference_can", "status"), [(True, Status.UNAVAILABLE), (False, Status.INPUT)]
)
def test_a_model_that_only_the_release_cannot_load_is_unavailable(
    pool: WorkerPool, monkeypatch: pytest.MonkeyPatch, reference_can: bool, status: Status
) -> None:
    old = ReleaseSpec("2.3.7", "2.3.7")

    def fix_work(pair: StepPair) -> None:
        if not reference_can or pair._targets[1].release == old:
            raise InputError("it has an unknown element")

    monkeypatch.setattr(StepPair, "fix_work", fix_work)
    task = StepTask((INSTALLED, old), CARTPOLE.model)
    with pytest.raises(InputError, match="unknown element") as raised:
        task.prepare(pool)
    assert raised.value.status == status


def test_what_a_release_lacks_is_said_and_not_timed(pool: WorkerPool) -> None:
    old = ReleaseSpec("9.9.9", "9.9.9")
    (record,) = timing.measure(pool, [StepTask((INSTALLED, old), CARTPOLE.model)])
    assert record.status in (Status.INPUT, Status.FAILED)
    assert "9.9.9" in record.detail
    assert record.launches == []


@pytest.mark.parametrize("name", [*operations.registry()])
def test_every_operation_computes_the_same_whenever_it_is_prepared(name: str) -> None:
    operation = operations.registry()[name]
    first, second = operation.prepared(), operation.prepared()
    first.run()
    result = first.result()
    assert result.size
    assert np.isfinite(result).all()
    assert np.array_equal(result, second.result())


def test_the_time_of_a_run_is_that_of_the_blocks_of_the_reference_alone() -> None:
    orders = ["ABBA", "BAAB"]
    ns = np.array([[100.0, 900.0, 900.0, 110.0], [900.0, 120.0, 130.0, 900.0]])
    assert timing.run_ns(orders, ns, np.array([0, 0]), 1) == 115.0
    # two layouts with whole runs of their own, and two sections of a run
    assert timing.run_ns(orders, ns, np.array([0, 1]), 1) == 115.0
    assert timing.run_ns(orders, ns, np.array([0, 1]), 2) == 230.0


def test_sections_of_different_runs_are_different_work() -> None:
    ratios = np.array([1.0, 1.3, 1.0, 1.3, 1.2, 1.4, 1.2, 1.4])
    ns = 100.0 * np.stack([np.ones(8), ratios, ratios, np.ones(8)], axis=1)
    parts = section_numbers([4, 4], [0, 1], 2)
    assert stats.total_log_ratio(["ABBA"] * 8, ns, parts) == pytest.approx(np.log(4.9 / 4))
    assert timing.run_ns(["ABBA"] * 8, ns, parts, 2) == 200.0


def test_a_process_that_cannot_read_its_work_leaves_no_answer_of_the_other_behind(
    pool: WorkerPool,
) -> None:
    task = StepTask(BOTH, CARTPOLE.model)
    task.prepare(pool)
    work = task._pair
    missing = work.workloads[0].with_suffix(".missing")
    processes = pool.start(INSTALLED), pool.start(INSTALLED, side=1)
    for process in processes:
        pool.wait_for(process, INSTALLED)
    work.workloads = missing, work.workloads[1]
    with pytest.raises(ChildError, match="missing"):
        task.equip(processes)
    assert processes[1].call(Worker.count_cores, 1) > 0
    pool.end(processes)
    task.close()
