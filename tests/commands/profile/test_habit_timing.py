"""The overhead table: every habit, with its cheaper form and its interval."""

from typing import Any

import pytest

from mjbench.commands.profile import habit_timing, habits
from mjbench.commands.profile.habit_timing import Launch
from mjbench.commands.profile.habits import ONE_CALL, ZERO_STEPS
from mjbench.host import isolate
from mjbench.simulation import models
from mjbench.simulation.starts import Starts
from mjbench.status import Status


def test_the_table_has_every_habit_with_its_cheaper_form(
    monkeypatch: pytest.MonkeyPatch, inline: None
) -> None:
    monkeypatch.setattr(habit_timing, "MOST_QUADS", 3)
    monkeypatch.setattr(habit_timing, "BLOCK_S", 1e-4)
    table = habit_timing.measure(models.resolve("cartpole"), launches=2)
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
    assert habit_timing.quads(1.0, 1e-3) == habit_timing.MOST_QUADS
    assert habit_timing.quads(1.0, 0.125) == 8
    assert habit_timing.quads(1.0, 10.0) == 1


def test_the_budget_bounds_the_launches(monkeypatch: pytest.MonkeyPatch) -> None:
    measured = Launch(10, 1000.0, {h.name: 10.0 for h in (ONE_CALL, ZERO_STEPS)}, Starts(0.1, 0.1))
    ended: list[int] = []

    def call(
        function: object, source: object, plan: object, seed: int, *rest: Any, **_: Any
    ) -> Any:
        ended.append(seed)
        return measured

    monkeypatch.setattr(isolate, "call", call)
    for budget_s, count in (
        (0.5, habit_timing.LEAST_LAUNCHES),
        (4.5, 4),
        (100.0, habit_timing.LAUNCHES),
    ):
        ended.clear()
        source = models.resolve("cartpole")
        habit_timing.measure(source, budget_s=budget_s, clock=lambda: float(len(ended)))
        assert ended == list(range(count))
