"""Cells are measured once each, whatever nodes do: die, refuse, come back, or share a machine."""

import itertools

import pytest
from sweep_examples import count_cell, node, verdict_cell

from mjbench.sweep.cells import Cell
from mjbench.sweep.scheduler import Assignment, Scheduler

MODELS = ("a", "b", "c", "d")
RELEASES = ("3.5.0", "3.9.0", "4.0.0")
CELLS = [verdict_cell(model, release) for release in RELEASES for model in MODELS]


def done(scheduler: Scheduler, assignment: Assignment, now_s: float = 0.0) -> list[Cell]:
    """End an assignment well; return its cells."""
    scheduler.begin(assignment.number, now_s)
    for cell in assignment.cells:
        assert scheduler.deliver(assignment.number, cell)
    assert scheduler.end(assignment.number, "", now_s) == []
    return list(assignment.cells)


def test_one_node_compares_two_releases_on_all_models_by_one_command() -> None:
    scheduler = Scheduler(CELLS)
    scheduler.join(node("one"))
    (assignment,) = scheduler.assign(0.0)
    assert assignment.cells == tuple(CELLS[:4])
    assert scheduler.assign(1.0) == []


def test_the_fewer_cells_are_left_for_each_node_the_fewer_it_gets() -> None:
    scheduler = Scheduler(CELLS)
    for name in "vwxyz":
        scheduler.join(node(name))
    sizes = [len(assignment.cells) for assignment in scheduler.assign(0.0)]
    assert sizes == [2, 1, 1, 1, 1]


def test_all_cells_are_measured_and_then_it_is_done() -> None:
    scheduler = Scheduler(CELLS)
    scheduler.join(node("one"))
    measured: list[Cell] = []
    while assignments := scheduler.assign(0.0):
        assert not scheduler.is_done
        measured += [cell for one in assignments for cell in done(scheduler, one)]
    assert scheduler.is_done
    assert measured == CELLS


def test_two_nodes_on_one_machine_do_not_measure_time_at_once() -> None:
    scheduler = Scheduler(CELLS)
    scheduler.join(node("one", host="machine"))
    scheduler.join(node("two", host="machine"))
    scheduler.join(node("three"))
    assignments = scheduler.assign(0.0)
    assert [assignment.node.id for assignment in assignments] == ["one", "three"]
    done(scheduler, assignments[0])
    assert [assignment.node.host for assignment in scheduler.assign(1.0)] == ["machine"]


def test_counts_share_a_machine_with_each_other_and_never_with_time() -> None:
    counts = [count_cell(model, release) for model in MODELS for release in RELEASES]
    scheduler = Scheduler([*counts, *CELLS[:3]])
    scheduler.join(node("one", cores=2))
    (timed,) = scheduler.assign(0.0)
    assert timed.command.needs_quiet
    done(scheduler, timed)
    shared = scheduler.assign(1.0)
    assert [assignment.command.needs_quiet for assignment in shared] == [False, False]
    assert len(shared) == 2, "as many as the machine has cores"


def test_no_count_begins_while_time_waits_for_the_machine() -> None:
    counts = [count_cell(model) for model in MODELS]
    scheduler = Scheduler([*CELLS[:1], *counts])
    scheduler.join(node("one", cores=2))
    (timed,) = scheduler.assign(0.0)
    scheduler.refuse(timed.number, "busy", 0.0)
    first, second = scheduler.assign(1.0)  # while it rests from measuring time
    done(scheduler, first)
    assert scheduler.assign(100.0) == [], "the other count ends first"
    done(scheduler, second)
    (timed,) = scheduler.assign(101.0)
    assert timed.command.needs_quiet


def test_what_a_node_refuses_another_one_measures_and_the_node_is_asked_again() -> None:
    scheduler = Scheduler(CELLS[:1])
    scheduler.join(node("one"))
    (first,) = scheduler.assign(0.0)
    scheduler.refuse(first.number, "others keep it busy", 0.0)
    assert scheduler.assign(1.0) == []
    scheduler.join(node("two"))
    (second,) = scheduler.assign(1.0)
    assert second.node.id == "two"
    scheduler.refuse(second.number, "busy, too", 1.0)
    (third,) = scheduler.assign(16.0)
    assert third.node.id == "one"


def test_a_node_that_refuses_again_and_again_is_asked_less_often() -> None:
    scheduler = Scheduler(CELLS[:1], patience_s=1e9)
    scheduler.join(node("one"))
    asked, now_s = [], 0.0
    while len(asked) < 7:
        for assignment in scheduler.assign(now_s):
            scheduler.refuse(assignment.number, "busy", now_s)
            asked.append(now_s)
        now_s += 1.0
    waits = [later - earlier for earlier, later in itertools.pairwise(asked)]
    assert waits == [15.0, 30.0, 60.0, 120.0, 240.0, 300.0]


def test_a_node_may_refuse_for_days() -> None:
    scheduler = Scheduler(CELLS[:1], patience_s=1e9)
    scheduler.join(node("one"))
    for turn in range(1100):  # longer than a power of two as a float can be
        (assignment,) = scheduler.assign(300.0 * turn)
        scheduler.refuse(assignment.number, "busy", 300.0 * turn)
    assert scheduler.nodes[0].refused == 1100


def test_a_sweep_that_all_nodes_refuse_ends_with_their_reasons() -> None:
    scheduler = Scheduler(CELLS[:1], patience_s=20.0)
    scheduler.join(node("one"))
    (assignment,) = scheduler.assign(0.0)
    scheduler.refuse(assignment.number, "others keep 2.0 of 2 cores busy", 5.0)
    assert not scheduler.is_stuck(19.0)
    assert scheduler.is_stuck(20.0)
    assert scheduler.reasons() == ["one: others keep 2.0 of 2 cores busy"]


def test_a_sweep_is_not_stuck_while_something_is_measured() -> None:
    scheduler = Scheduler(CELLS, patience_s=20.0)
    scheduler.join(node("one"))
    (assignment,) = scheduler.assign(0.0)
    scheduler.begin(assignment.number, 1.0)
    assert not scheduler.is_stuck(1000.0)
    done(scheduler, assignment, 1000.0)
    assert not scheduler.is_stuck(1019.0)


def test_without_nodes_it_says_so() -> None:
    scheduler = Scheduler(CELLS[:1], patience_s=20.0)
    scheduler.join(node("one"))
    scheduler.leave("one", "it is gone")
    assert scheduler.assign(0.0) == []
    assert scheduler.is_stuck(20.0)
    assert scheduler.reasons() == ["one: it is gone", "there is no node"]


def test_cells_of_a_dead_node_are_measured_elsewhere_but_not_those_it_delivered() -> None:
    scheduler = Scheduler(CELLS[:3])
    scheduler.join(node("one"))
    (assignment,) = scheduler.assign(0.0)
    assert scheduler.deliver(assignment.number, CELLS[0])
    scheduler.join(node("two"))
    scheduler.leave("one", "it is gone")
    assert scheduler.end(assignment.number, "its node is gone", 1.0) == []
    (again,) = scheduler.assign(1.0)
    assert (again.node.id, again.cells) == ("two", (CELLS[1],)), "alone, as it failed before"
    assert scheduler.missing == (CELLS[2], CELLS[1])


def test_what_arrives_late_from_a_dead_node_is_not_stored_again() -> None:
    scheduler = Scheduler(CELLS[:1])
    scheduler.join(node("one"))
    scheduler.join(node("two"))
    (first,) = scheduler.assign(0.0)
    scheduler.end(first.number, "its worker was killed", 0.0)
    (second,) = scheduler.assign(0.0)
    assert second.node.id == "two"
    assert not scheduler.deliver(first.number, CELLS[0])
    assert scheduler.deliver(second.number, CELLS[0])
    assert not scheduler.deliver(second.number, CELLS[0])


def test_a_cell_that_failed_goes_to_another_machine_and_back_only_where_there_is_none() -> None:
    scheduler = Scheduler(CELLS[:1])
    scheduler.join(node("one"))
    scheduler.join(node("two"))
    (first,) = scheduler.assign(0.0)
    scheduler.end(first.number, "killed", 0.0)
    (second,) = scheduler.assign(1000.0)
    assert second.node.id == "two"
    scheduler.end(second.number, "killed", 1000.0)
    (third,) = scheduler.assign(2000.0)
    assert third.node.id == "one"


def test_a_cell_is_given_up_after_as_many_tries_as_the_plan_allows() -> None:
    scheduler = Scheduler(CELLS[:2], tries=2)
    scheduler.join(node("one"))
    (first,) = scheduler.assign(0.0)
    assert scheduler.end(first.number, "killed", 0.0) == []
    lost = []
    for now_s in (1000.0, 2000.0):
        (assignment,) = scheduler.assign(now_s)
        lost += scheduler.end(assignment.number, "killed again", now_s)
    assert [(item.cell, item.detail) for item in lost] == [
        (CELLS[0], "killed again"),
        (CELLS[1], "killed again"),
    ]
    assert scheduler.is_done


def test_what_a_node_never_began_costs_no_try() -> None:
    scheduler = Scheduler(CELLS[:1], tries=1)
    scheduler.join(node("one"))
    for now_s in (0.0, 1000.0, 2000.0):
        (assignment,) = scheduler.assign(now_s)
        assert not scheduler.has_begun(assignment.number)
        scheduler.refuse(assignment.number, "it is taken by other work", now_s)
    assert scheduler.missing == (CELLS[0],)


def test_a_cell_of_a_machine_waits_for_that_machine() -> None:
    cells = [verdict_cell("a", machine="epyc"), verdict_cell("a", machine="xeon")]
    scheduler = Scheduler(cells, patience_s=20.0)
    scheduler.join(node("one", label="xeon"))
    (assignment,) = scheduler.assign(0.0)
    assert assignment.cells == (cells[1],)
    done(scheduler, assignment)
    assert scheduler.assign(1.0) == []
    assert scheduler.is_stuck(21.0)
    assert scheduler.reasons() == ["no node has the label epyc"]


def test_a_node_that_comes_back_gets_work_again() -> None:
    scheduler = Scheduler(CELLS[:1])
    scheduler.join(node("one"))
    scheduler.leave("one", "it is gone")
    assert scheduler.assign(0.0) == []
    scheduler.join(node("one"))
    assert len(scheduler.assign(0.0)) == 1


@pytest.mark.parametrize("count", [1, 3, 20])
def test_counts_of_few_cells_keep_their_releases_together(count: int) -> None:
    releases = [f"3.{minor}.0" for minor in range(6)]
    scheduler = Scheduler([count_cell("a", release) for release in releases])
    for number in range(count):
        scheduler.join(node(str(number)))
    sizes = [len(assignment.cells) for assignment in scheduler.assign(0.0)]
    assert min(sizes[:-1], default=4) >= 3
