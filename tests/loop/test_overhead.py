"""The overhead table: every habit, with its cheaper form and its interval."""

from pathlib import Path

import pytest

from mjbench.errors import InputError
from mjbench.loop import habits, overhead
from mjbench.simulation import models
from mjbench.status import Status


def test_the_table_has_every_habit_with_its_cheaper_form() -> None:
    table = overhead.measure(models.resolve("cartpole"), launches=2)
    assert {cost.source for cost in table.costs or ()} == {
        habit.name for habit in habits.HABITS if habit not in (habits.BARE, habits.ZERO_STEPS)
    }
    for cost in table.costs or ():
        assert cost.low <= cost.ns <= cost.high
        assert (cost.saved_ns is None) == (not cost.cheaper)
        assert "mj_step(model, data" in cost.code
    assert table.bare_ns > 0
    assert table.nstep > 0
    assert (table.status, table.model, table.is_measured) == (Status.OK, "cartpole", True)


def test_the_budget_bounds_the_quads_of_a_habit() -> None:
    assert overhead.quads(1.0, 1e-3) == overhead.MOST_QUADS
    assert overhead.quads(1.0, 0.125) == 8
    assert overhead.quads(1.0, 10.0) == overhead.LEAST_QUADS


def test_a_model_that_does_not_load_is_bad_input(tmp_path: Path) -> None:
    file = tmp_path / "broken.xml"
    file.write_text("<mujoco><nothing/></mujoco>")
    with pytest.raises(InputError, match=r"broken\.xml"):
        overhead.measure(models.resolve(str(file)))


def test_the_row_of_a_failure_has_nothing_but_its_reason() -> None:
    row = overhead.OverheadRow("robot.xml", Status.INPUT, "no such file")
    assert not row.is_measured
    assert (row.status, row.detail, row.bare_ns, row.costs) == ("input", "no such file", None, None)
