"""Cells that wait keep their order, whatever groups they are in."""

from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st
from sweep_examples import count_cell, verdict_cell

from mjbench.sweep.cells import Cell
from mjbench.sweep.commands import COMMANDS
from mjbench.sweep.waiting import Waiting

RELEASES = ("3.5.0", "3.9.0", "4.0.0")
CELLS = [
    replace(make(model, release), machine=machine)
    for machine in ("", "a", "b")
    for make in (verdict_cell, count_cell)
    for model in ("m", "n")
    for release in RELEASES
]


def expected(cells: list[Cell], label: str, needs_quiet: bool, most: int) -> tuple[Cell, ...]:
    """Return the first cell of a list that may be measured, with those of its command."""
    able = [
        cell
        for cell in cells
        if cell.machine in ("", label) and COMMANDS[cell.kind].needs_quiet == needs_quiet
    ]
    together = [
        cell
        for cell in able
        if (cell.kind, cell.machine) == (able[0].kind, able[0].machine)
        and COMMANDS[cell.kind].together(cell) == COMMANDS[able[0].kind].together(able[0])
    ]
    return tuple(together[:most])


@given(
    st.lists(
        st.tuples(st.sampled_from("ab"), st.booleans(), st.integers(1, 4), st.booleans()),
        max_size=20,
    )
)
def test_the_next_cells_are_those_of_a_plain_list(
    turns: list[tuple[str, bool, int, bool]],
) -> None:
    waiting, cells = Waiting(CELLS), list(CELLS)
    for label, needs_quiet, most, is_put_back in turns:
        taken = waiting.next_together(label, needs_quiet, most)
        assert taken == expected(cells, label, needs_quiet, most)
        if not taken:
            continue
        waiting.take(taken)
        cells = [cell for cell in cells if cell not in taken]
        if is_put_back:
            waiting.put_first(taken)
            cells = [*taken, *cells]
        assert list(waiting) == cells
        assert len(waiting) == len(cells)


def test_cells_that_failed_come_last_and_alone() -> None:
    cells = [verdict_cell(model, "3.5.0") for model in ("m", "n", "o")]
    waiting = Waiting(cells)
    taken = waiting.next_together("", True, most=2)
    waiting.take(taken)
    waiting.put_last(taken)
    assert list(waiting) == [cells[2], cells[0], cells[1]]
    assert waiting.failed == [cells[0], cells[1]]
    assert waiting.count("", needs_quiet=True) == 1
    waiting.take([cells[1]])
    assert waiting.failed == [cells[0]]


def test_labels_are_those_of_cells_that_wait() -> None:
    waiting = Waiting([cell for cell in CELLS if cell.machine != "a"])
    assert waiting.labels() == {"b"}
    while taken := waiting.next_together("b", True, 9) or waiting.next_together("b", False, 9):
        waiting.take(taken)
    assert waiting.labels() == set()
    waiting.put_last([CELLS[-1]])
    assert waiting.labels() == {"b"}
