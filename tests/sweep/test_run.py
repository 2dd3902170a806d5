"""A sweep stores each result once as it comes, and says what is missing and why."""

import itertools
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import pytest
from sweep_examples import MACHINE, FakeCluster, count_cell, delivered, matrix, node, verdict_cell

from mjbench.errors import Failure, InputError, MachineError
from mjbench.status import Status
from mjbench.sweep.busy_node import NodeRules
from mjbench.sweep.cells import Cell
from mjbench.sweep.matrix import Matrix
from mjbench.sweep.node import Request
from mjbench.sweep.ray_cluster import Event, Failed, LeftOut, Refused
from mjbench.sweep.results import CellResult
from mjbench.sweep.run import NodeRecord, Summary, Sweep

CELLS = [verdict_cell(m, r) for r in ("3.5.0", "3.9.0", "4.0.0") for m in ("a", "b", "c")]


def measure(
    cells: Matrix,
    cluster: FakeCluster,
    done: Sequence[Cell] = (),
) -> tuple[Summary, list[CellResult]]:
    stored: list[CellResult] = []
    sweep = Sweep(cells, done, cluster, lambda result, node, ndone: stored.append(result))
    return sweep.measure(), stored


def fail_to_store(result: CellResult, node: str, ndone: int) -> None:
    raise MachineError("cannot write sweep.jsonl: No space left on device")


def test_every_cell_is_stored_once_with_its_key() -> None:
    summary, stored = measure(matrix(CELLS), FakeCluster([node("one"), node("two")]))
    assert Counter(result.section.cell for result in stored) == {cell.key: 1 for cell in CELLS}
    assert (summary.missing, summary.reasons, summary.is_interrupted) == ((), (), False)


def test_what_is_done_is_not_measured_again() -> None:
    cluster = FakeCluster([node("one")])
    _, stored = measure(matrix(CELLS), cluster, done=CELLS[:5])
    assert [result.cell for result in stored] == CELLS[5:]
    assert cluster.requests[0].line.arguments[:3] == ("versions", "--old", "3.3.0")


def test_a_command_knows_with_how_many_verdicts_its_own_are_decided() -> None:
    cluster = FakeCluster([node("one")])
    measure(matrix(CELLS), cluster)
    arguments = cluster.requests[0].line.arguments
    assert arguments[arguments.index("--family") + 1] == "9"


def test_only_what_is_timed_needs_a_quiet_node() -> None:
    cluster = FakeCluster([node("one")], lambda request: [])
    measure(matrix([CELLS[0], count_cell("a")]), cluster)
    assert [request.rules is not None for request in cluster.requests] == [True, False]


def test_what_a_failed_command_has_not_delivered_ends_as_it_failed() -> None:
    def act(request: Request) -> Iterator[Event]:
        yield delivered(request.cells[0])
        yield Failed(request, Failure(Status.CRASHED, "killed by signal 9 (SIGKILL)"), MACHINE)

    summary, stored = measure(matrix(CELLS[:3]), FakeCluster([node("one")], act))
    statuses = [outcome.status for outcome in summary.outcomes.values()]
    assert statuses == [Status.OK, Status.CRASHED, Status.CRASHED]
    assert stored[1].outcome.detail == "killed by signal 9 (SIGKILL)"
    assert summary.missing == ()


def test_what_failed_with_its_node_is_stored_of_a_machine_with_its_label() -> None:
    def act(request: Request) -> Iterable[Event]:
        return [Failed(request, Failure(Status.CRASHED, "its node is gone"))]

    nodes = [node("one", "epyc"), replace(node("two", "xeon"), machine=replace(MACHINE, cores=8))]
    _, (result,) = measure(matrix([verdict_cell("a", machine="xeon")]), FakeCluster(nodes, act))
    assert result.section.run.header.machine.cores == 8


def test_a_sweep_in_which_all_nodes_are_busy_ends_with_what_is_missing_and_why() -> None:
    times = itertools.count(step=NodeRules().patience_s)
    cluster = FakeCluster([node("one")], lambda request: [Refused(request, "one: it is busy")])
    sweep = Sweep(matrix(CELLS), (), cluster, fail_to_store, clock=lambda: next(times))
    summary = sweep.measure()
    assert (summary.missing, summary.reasons) == (tuple(CELLS), ("one: it is busy",))


def test_what_a_busy_node_gives_back_is_measured_elsewhere() -> None:
    refused: list[Request] = []

    def act(request: Request) -> Iterable[Event]:
        if refused:
            return map(delivered, request.cells)
        refused.append(request)
        return [delivered(request.cells[0]), Refused(request, "one: it is busy")]

    summary, stored = measure(matrix(CELLS), FakeCluster([node("one"), node("two")], act))
    assert Counter(result.cell for result in stored) == dict.fromkeys(CELLS, 1)
    assert summary.missing == ()


def test_what_no_node_is_left_for_is_missing() -> None:
    summary, _ = measure(matrix(CELLS), FakeCluster([node("one")], lambda request: []))
    assert summary.missing == tuple(CELLS)
    assert summary.reasons == ("there is no node that could measure",)


def test_interrupted_it_keeps_what_came_before() -> None:
    def act(request: Request) -> Iterator[Event]:
        yield delivered(request.cells[0])
        raise KeyboardInterrupt

    summary, stored = measure(matrix(CELLS), FakeCluster([node("one")], act))
    assert [result.cell for result in stored] == CELLS[:1]
    assert (summary.is_interrupted, summary.missing) == (True, tuple(CELLS[1:]))


def test_a_result_that_cannot_be_stored_ends_the_sweep() -> None:
    sweep = Sweep(matrix(CELLS), (), FakeCluster([node("one")]), fail_to_store)
    with pytest.raises(MachineError, match="No space left"):
        sweep.measure()


def test_progress_counts_what_was_done_before() -> None:
    seen: list[tuple[Cell, str, int]] = []
    cluster = FakeCluster([node("one")])
    Sweep(
        matrix(CELLS), CELLS[:7], cluster, lambda result, *rest: seen.append((result.cell, *rest))
    ).measure()
    assert seen == [(CELLS[7], "one", 8), (CELLS[8], "one", 9)]


def test_what_nodes_did_is_summed_up_also_of_those_that_joined_later() -> None:
    def act(request: Request) -> Iterator[Event]:
        yield delivered(request.cells[0], objection="others keep it busy")
        yield delivered(request.cells[1])
        yield delivered(request.cells[2], on="late")

    summary, _ = measure(matrix(CELLS[:3]), FakeCluster([node("one")], act))
    assert summary.nodes == (
        NodeRecord("one", "", 2, 24.0, 15.0, "others keep it busy"),
        NodeRecord("late", "", 1, 12.0),
    )


@pytest.mark.parametrize(
    ("left_out", "reason"),
    [
        ([LeftOut("id", "two", "Python 3.12 instead of 3.11")], r"two: Python 3\.12 instead"),
        ([], "none declares the resource: ray start --resources"),
    ],
)
def test_without_a_node_that_can_measure_nothing_begins(
    left_out: list[LeftOut], reason: str
) -> None:
    with pytest.raises(MachineError, match=rf"no node of the cluster can measure \({reason}"):
        measure(matrix(CELLS), FakeCluster([], left_out=left_out))


def test_a_label_that_no_node_has_is_refused_before_anything_begins() -> None:
    cluster = FakeCluster([node("one", label="epyc"), node("two", label="xeon")])
    cells = [verdict_cell("a", machine=machine) for machine in ("epyc", "xeno")]
    with pytest.raises(InputError, match=r"label 'xeno' \(did you mean xeon\?\)"):
        measure(matrix(cells), cluster)
    assert cluster.requests == []


def test_a_label_of_cells_that_are_done_needs_no_node() -> None:
    cells = [verdict_cell("a", machine=machine) for machine in ("epyc", "xeon")]
    cluster = FakeCluster([node("one", label="epyc")])
    assert measure(matrix(cells), cluster, done=cells)[0].missing == ()
