"""A cell's key says what it is, and differs for all that would give another result."""

from dataclasses import replace

import pytest
from sweep_examples import count_cell, verdict_cell

from mjbench.paired.metrics import Metric
from mjbench.sweep.cells import Cell, CellKind

CELL = verdict_cell("humanoid")


@pytest.mark.parametrize(
    ("cell", "name"),
    [
        (CELL, "versions humanoid 3.3.0 → 4.0.0 python_loop"),
        (replace(CELL, metric=Metric.P99), "versions humanoid 3.3.0 → 4.0.0 python_loop p99"),
        (replace(CELL, machine="epyc"), "versions humanoid 3.3.0 → 4.0.0 python_loop on epyc"),
        (count_cell("a b.xml"), "instructions a b.xml 4.0.0"),
        (Cell(CellKind.COMPARE, "pile"), "compare pile"),
        (Cell(CellKind.HISTORY, "pile", "3.5.0"), "history pile 3.5.0"),
    ],
)
def test_its_name_is_for_people(cell: Cell, name: str) -> None:
    assert cell.name == name
    assert cell.key.startswith(f"{name} #")


@pytest.mark.parametrize(
    "change",
    [
        {"model": "pile"},
        {"release": "3.9.0"},
        {"baseline": "3.2.0"},
        {"installed": "4.0.0"},
        {"path": "rollout"},
        {"metric": Metric.P99},
        {"machine": "epyc"},
        {"content": "other files, options or versions"},
    ],
)
def test_another_cell_has_another_key(change: dict[str, str]) -> None:
    assert replace(CELL, **change).key != CELL.key  # type: ignore[arg-type]


def test_the_key_of_a_cell_stays_as_run_sets_have_it() -> None:
    assert CELL.key == "versions humanoid 3.3.0 → 4.0.0 python_loop #0b61866938"
