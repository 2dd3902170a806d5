"""What a sweep prints at its end."""

from sweep_examples import verdict_cell

from mjbench.report import sweep
from mjbench.status import Status
from mjbench.sweep.results import CellOutcome


def test_of_many_failed_cells_the_first_are_named_and_the_others_counted() -> None:
    outcomes = {verdict_cell(f"m{i:03}"): CellOutcome(Status.FAILED, "why") for i in range(60)}
    outcomes[verdict_cell("good")] = CellOutcome(Status.OK)
    lines = [conclusion.text for conclusion in sweep.failures(outcomes)]
    assert lines[0].endswith(": failed, why")
    assert "m049" in lines[49]
    assert lines[50:] == ["10 further results failed."]
