"""Costs are measured once; a table that cannot be used stops nothing."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from mjbench.simulation import models
from mjbench.simulation.model_digest import model_digest
from mjbench.verification import step_costs


@pytest.fixture
def table(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the file of a user's table, which is not there yet."""
    file = tmp_path / "cache" / "costs.json"
    monkeypatch.setenv(step_costs.FILE_VARIABLE, str(file))
    return file


def stopwatch(*readings: float) -> Callable[[], float]:
    """Return a function that returns one reading after the other."""
    remaining = iter(readings)
    return lambda: next(remaining)


def test_a_cost_is_measured_once(table: Path) -> None:
    measure = stopwatch(1.1e-5)
    costs = {step_costs.step_cost_s("other", measure) for _ in range(3)}
    assert costs == {2.0**-16}
    assert json.loads(table.read_text()) == {"other": 1.1e-5}


def test_models_have_costs_of_their_own(table: Path) -> None:
    costs = [step_costs.step_cost_s(name, stopwatch(s)) for name, s in (("a", 1.0), ("b", 4.0))]
    assert costs == [1.0, 4.0]
    assert set(json.loads(table.read_text())) == {"a", "b"}


def test_another_process_that_was_first_decides(table: Path) -> None:
    def measure() -> float:
        table.parent.mkdir()
        table.write_text('{"other": 1.0}')
        return 8.0

    assert step_costs.step_cost_s("other", measure) == 1.0


@pytest.mark.parametrize("name", models.shipped())
def test_every_shipped_model_has_a_cost(name: str, table: Path) -> None:
    digest = model_digest(models.load(models.resolve(name)))
    cost_s = step_costs.step_cost_s(digest, stopwatch())
    assert 1e-7 < cost_s < 1e-1
    assert not table.exists()


@pytest.mark.parametrize(
    "content", ["", "{", "[1]", '{"other": null}', '{"other": -1}', '{"other": NaN}', "[" * 9999]
)
def test_a_damaged_table_is_replaced(table: Path, content: str) -> None:
    table.parent.mkdir()
    table.write_text(content)
    assert step_costs.step_cost_s("other", stopwatch(2.0)) == 2.0
    assert json.loads(table.read_text()) == {"other": 2.0}


def test_a_table_that_cannot_be_written_stops_nothing(table: Path) -> None:
    table.parent.write_text("a file where the folder would be")
    assert step_costs.step_cost_s("other", stopwatch(2.0)) == 2.0
    assert step_costs.step_cost_s("other", stopwatch(0.0)) == step_costs.rounded_s(1e-9)


def test_rounding_is_by_ratio() -> None:
    assert [step_costs.rounded_s(s) for s in (1.0, 1.4, 1.5, 2.7, 3e-6)] == [1, 1, 2, 2, 2.0**-18]
