"""A sweep on a cluster that fails in all ways: no cell is lost, and none is measured twice."""

from collections import Counter
from collections.abc import Callable, Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st
from sweep_examples import FakeCluster, header, line, matrix, node, plan, verdict, verdict_cell

from mjbench.errors import InputError, MachineError
from mjbench.report.documents import RECORD_TYPES
from mjbench.status import Status
from mjbench.sweep.cells import Cell
from mjbench.sweep.executor import Event, LeftOut, Reported
from mjbench.sweep.matrix import Matrix
from mjbench.sweep.messages import Began, Lines
from mjbench.sweep.plan import NodeRules
from mjbench.sweep.results import CellResult
from mjbench.sweep.run import Progress, Summary, Sweep

CELLS = [verdict_cell(m, r) for r in ("3.5.0", "3.9.0", "4.0.0") for m in ("a", "b", "c")]


def steady(cluster: FakeCluster) -> Sequence[Event]:
    """Have every node deliver its next cell."""
    return [event for number in list(cluster.running) for event in cluster.delivers(number)]


def measure(
    cells: Matrix,
    cluster: FakeCluster,
    done: Sequence[Cell] = (),
    on_progress: Callable[[Progress], None] = lambda progress: None,
) -> tuple[Summary, list[CellResult]]:
    stored: list[CellResult] = []
    sweep = Sweep(
        cells,
        done,
        cluster,
        stored.append,
        RECORD_TYPES,
        on_progress=on_progress,
        clock=cluster.clock,
    )
    sweep.take_nodes(cluster.joined())
    return sweep.measure(), stored


def statuses(stored: Sequence[CellResult]) -> dict[str, Status]:
    return {result.cell.name: result.outcome.status for result in stored}


def test_every_cell_is_stored_once_with_its_key() -> None:
    summary, stored = measure(matrix(CELLS), FakeCluster([node("one"), node("two")], steady))
    assert Counter(result.section.cell for result in stored) == {cell.key: 1 for cell in CELLS}
    assert all(result.section.lines[0] == header() for result in stored)
    assert (summary.missing, summary.reasons, summary.is_interrupted) == ((), (), False)
    assert sum(record.cells for record in summary.nodes) == len(CELLS)


def test_what_is_done_is_not_measured_again() -> None:
    cluster = FakeCluster([node("one")], steady)
    _, stored = measure(matrix(CELLS), cluster, done=CELLS[:5])
    assert {result.cell for result in stored} == set(CELLS[5:])
    first, *_ = cluster.began
    assert first.request.line.arguments[:3] == ("versions", "--old", "3.3.0")


def test_a_command_knows_with_how_many_verdicts_its_own_are_decided() -> None:
    cluster = FakeCluster([node("one")], steady)
    measure(matrix(CELLS), cluster)
    arguments = cluster.began[0].request.line.arguments
    assert arguments[arguments.index("--family") + 1] == "9"


def test_a_killed_node_loses_only_what_it_had_not_delivered() -> None:
    def act(cluster: FakeCluster) -> Sequence[Event]:
        if cluster.time_s == 2:
            return cluster.leaves("one")
        return steady(cluster)

    cluster = FakeCluster([node("one"), node("two")], act)
    summary, stored = measure(matrix(CELLS), cluster)
    assert Counter(result.cell for result in stored) == dict.fromkeys(CELLS, 1)
    assert set(statuses(stored).values()) == {Status.OK}
    one, two = summary.nodes
    assert (one.is_there, one.cells, one.failed) == (False, 1, 1)
    assert two.cells == len(CELLS) - 1


def test_a_cell_that_fails_by_itself_is_stored_as_such_once() -> None:
    def act(cluster: FakeCluster) -> Sequence[Event]:
        events: list[Event] = []
        for number, work in list(cluster.running.items()):
            bad = verdict(work.cells[0], Status.CRASHED)
            lines = (header(), line(bad), *(line(verdict(c)) for c in work.cells[1:]))
            events += [Reported(number, Began()), Reported(number, Lines(lines))]
            events += cluster.finishes(number, 3, "it failed")
        return events

    summary, stored = measure(matrix(CELLS[:3]), FakeCluster([node("one")], act))
    assert list(statuses(stored).values()) == [Status.CRASHED, Status.OK, Status.OK]
    assert summary.nodes[0].failed == 0, "the command did what it was to do"


def test_a_command_that_dies_each_time_ends_as_a_failed_cell() -> None:
    def act(cluster: FakeCluster) -> Sequence[Event]:
        return [e for n in list(cluster.running) for e in cluster.finishes(n, -9)]

    summary, stored = measure(matrix(CELLS[:1]), FakeCluster([node("one")], act))
    (result,) = stored
    assert result.section.cell == CELLS[0].key
    assert (result.outcome.status, result.outcome.detail) == (
        Status.CRASHED,
        "killed by signal 9 (SIGKILL)",
    )
    assert summary.nodes[0].failed == 3
    assert summary.missing == ()


def test_a_command_line_that_is_refused_is_not_tried_elsewhere() -> None:
    def act(cluster: FakeCluster) -> Sequence[Event]:
        return [e for n in list(cluster.running) for e in cluster.finishes(n, 2, "no such thing")]

    _, stored = measure(matrix(CELLS[:3]), FakeCluster([node("one"), node("two")], act))
    assert {result.outcome.detail for result in stored} == {"no such thing"}
    assert set(statuses(stored).values()) == {Status.INPUT}
    assert len(stored) == 3


def test_a_node_that_sends_something_else_is_stopped_and_counts_as_failed() -> None:
    def act(cluster: FakeCluster) -> Sequence[Event]:
        for number, work in cluster.running.items():
            if work.node.id == "one":
                return [Reported(number, Lines((b"not a run file\n", b"at all\n")))]
        return steady(cluster)

    cluster = FakeCluster([node("one"), node("two")], act)
    summary, stored = measure(matrix(CELLS[:3]), cluster)
    assert set(statuses(stored).values()) == {Status.OK}
    assert cluster.stopped
    assert "not JSON" in summary.nodes[0].reason


def test_what_a_node_says_after_it_was_stopped_is_left_out() -> None:
    def act(cluster: FakeCluster) -> Sequence[Event]:
        for number, work in list(cluster.running.items()):
            if work.node.id == "one":
                bad = Reported(number, Lines((b"not a run file\n", b"at all\n")))
                return [bad, *cluster.finishes(number, 2)]
        return steady(cluster)

    cluster = FakeCluster([node("one"), node("two")], act)
    summary, stored = measure(matrix(CELLS[:3]), cluster)
    assert set(statuses(stored).values()) == {Status.OK}
    assert summary.nodes[0].cells == 0
    assert summary.outcomes == {result.cell: result.outcome for result in stored}


def test_what_a_node_does_not_begin_goes_elsewhere() -> None:
    def act(cluster: FakeCluster) -> Sequence[Event]:
        return [
            event
            for number, work in list(cluster.running.items())
            if work.node.id != "taken"
            for event in cluster.delivers(number)
        ]

    cluster = FakeCluster([node("taken"), node("free")], act)
    summary, stored = measure(matrix(CELLS), cluster)
    assert len(stored) == len(CELLS)
    assert summary.nodes[0].reason == "it is taken by other work of the cluster"


def test_a_sweep_that_all_nodes_refuse_ends_with_what_is_missing_and_why() -> None:
    def act(cluster: FakeCluster) -> Sequence[Event]:
        return [event for number in list(cluster.running) for event in cluster.refuses(number)]

    summary, stored = measure(matrix(CELLS), FakeCluster([node("one")], act))
    assert stored == []
    assert summary.missing == tuple(CELLS)
    assert summary.reasons == ("one: others keep it busy",)


def test_a_result_that_cannot_be_stored_ends_the_sweep() -> None:
    def store(result: CellResult) -> None:
        raise MachineError("cannot write sweep.jsonl: No space left on device")

    cluster = FakeCluster([node("one")], steady)
    sweep = Sweep(matrix(CELLS), (), cluster, store, RECORD_TYPES, clock=cluster.clock)
    sweep.take_nodes(cluster.joined())
    with pytest.raises(MachineError, match="No space left"):
        sweep.measure()


def test_progress_counts_what_was_done_before() -> None:
    seen: list[Progress] = []
    cluster = FakeCluster([node("one")], steady)
    measure(matrix(CELLS), cluster, done=CELLS[:4], on_progress=seen.append)
    assert (seen[0].done, seen[0].count) == (4, 9)
    assert (seen[-1].done, seen[-1].running) == (9, ())
    assert seen[0].running[0].cells == (CELLS[4], CELLS[5])


def test_a_plan_without_a_node_that_can_measure_begins_nothing() -> None:
    cluster = FakeCluster([], steady)
    sweep = Sweep(matrix(CELLS), (), cluster, print, RECORD_TYPES, clock=cluster.clock)
    with pytest.raises(MachineError, match=r"no node of the cluster can measure \(two: Python 3"):
        sweep.take_nodes([LeftOut("two", "Python 3.12 instead of 3.11")])


def test_a_label_that_no_node_has_is_refused_before_anything_begins() -> None:
    cluster = FakeCluster([node("one", label="epyc"), node("two", label="xeon")], steady)
    cells = [verdict_cell("a", machine=machine) for machine in ("epyc", "xeno")]
    with pytest.raises(InputError, match=r"label 'xeno' \(did you mean xeon\?\)"):
        measure(matrix(cells), cluster)
    assert cluster.began == []


def test_a_label_of_cells_that_are_done_needs_no_node() -> None:
    cells = [verdict_cell("a", machine=machine) for machine in ("epyc", "xeon")]
    cluster = FakeCluster([node("one", label="epyc")], steady)
    measured = matrix(cells)
    sweep = Sweep(measured, cells, cluster, print, RECORD_TYPES, clock=cluster.clock)
    sweep.take_nodes(cluster.joined())
    assert sweep.measure().missing == ()


NODES = [node("n0", "h0"), node("n1", "h0"), node("n2", "h1"), node("n3", "h2")]


class Chaos:
    """Does to a cluster what hypothesis draws."""

    def __init__(self, draw: st.DataObject, interrupts: bool):
        self._draw, self._interrupts = draw, interrupts
        self._steps = 0

    def __call__(self, cluster: FakeCluster) -> Sequence[Event]:
        self._steps += 1
        if self._steps > 60:  # at last, all is well
            gone = [one for one in NODES if one.id not in cluster.nodes]
            return cluster.joins(gone[0]) if gone else steady(cluster)
        hosts = Counter(work.node.host for work in cluster.running.values())
        assert max(hosts.values(), default=0) <= 1, "a machine measures one thing at a time"
        kinds = ["wait", "join"]
        if cluster.running:
            kinds += ["deliver"] * 4 + ["die", "refuse", "fail", "end"]
        if cluster.nodes:
            kinds.append("leave")
        if self._interrupts:
            kinds.append("interrupt")
        return self._do(cluster, self._draw.draw(st.sampled_from(kinds)))

    def _do(self, cluster: FakeCluster, kind: str) -> Sequence[Event]:
        pick = self._draw.draw
        if kind == "interrupt":
            raise KeyboardInterrupt
        if kind == "wait":
            cluster.time_s += pick(st.sampled_from([0.0, 20.0, 400.0]))
            return []
        if kind == "join":
            gone = [one for one in NODES if one.id not in cluster.nodes]
            return cluster.joins(pick(st.sampled_from(gone))) if gone else []
        if kind == "leave":
            return cluster.leaves(pick(st.sampled_from(sorted(cluster.nodes))))
        number = pick(st.sampled_from(sorted(cluster.running)))
        actions: dict[str, Callable[[int], list[Event]]] = {
            "deliver": cluster.delivers,
            "die": cluster.dies,
            "refuse": cluster.refuses,
            "fail": lambda n: cluster.finishes(n, 3, "the disk is full"),
            "end": lambda n: cluster.finishes(n, 0),
        }
        return actions[kind](number)


@given(st.data())
def test_whatever_happens_every_cell_is_stored_once(data: st.DataObject) -> None:
    cluster = FakeCluster(NODES[:2], Chaos(data, interrupts=False))
    patient = plan(rules=NodeRules(tries=4, patience_s=1e9))
    summary, stored = measure(Matrix(patient, tuple(CELLS), {}), cluster)
    assert Counter(result.section.cell for result in stored) == {cell.key: 1 for cell in CELLS}
    assert summary.missing == ()
    assert {result.outcome.status for result in stored} <= {
        Status.OK,
        Status.FAILED,
        Status.CRASHED,
    }


@given(st.data())
def test_interrupted_again_and_again_the_set_has_every_cell_once(data: st.DataObject) -> None:
    patient = plan(rules=NodeRules(tries=10, patience_s=1e9))
    every = Matrix(patient, tuple(CELLS), {})
    stored: list[CellResult] = []
    for turn in range(5):
        cluster = FakeCluster(NODES[:2], Chaos(data, interrupts=turn < 4))
        summary, new = measure(every, cluster, done=[result.cell for result in stored])
        stored += new
        assert set(summary.missing) == set(CELLS) - {result.cell for result in stored}
    assert Counter(result.section.cell for result in stored) == {cell.key: 1 for cell in CELLS}
