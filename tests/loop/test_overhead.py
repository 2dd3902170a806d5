"""The overhead table: every habit, with its cheaper form and its interval."""

import pytest

from mjbench.loop import habits, overhead
from mjbench.simulation import models
from mjbench.status import Status


def test_the_table_has_every_habit_with_its_cheaper_form(
    monkeypatch: pytest.MonkeyPatch, inline: None
) -> None:
    monkeypatch.setattr(overhead, "MOST_QUADS", overhead.LEAST_QUADS)
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


def test_the_row_of_a_failure_has_nothing_but_its_reason() -> None:
    row = overhead.OverheadRow("robot.xml", Status.INPUT, "no such file")
    assert not row.is_measured
    assert (row.status, row.detail, row.bare_ns, row.costs) == ("input", "no such file", None, None)
