"""What a sweep prints at its end."""

from sweep_examples import verdict_cell

from mjbench.report import sweep
from mjbench.status import Status
from mjbench.sweep.results import CellOutcome
from mjbench.sweep.run import Summary


def test_of_many_failed_cells_the_first_are_named_and_the_others_counted() -> None:
    outcomes = {verdict_cell(f"m{i:03}"): CellOutcome(Status.FAILED, "why") for i in range(60)}
    outcomes[verdict_cell("good")] = CellOutcome(Status.OK)
    lines = [conclusion.text for conclusion in sweep.section(outcomes, None).conclusions[1:]]
    assert lines[0].endswith(": failed, why")
    assert "m049" in lines[49]
    assert lines[50:] == ["10 further results failed."]


def test_a_sweep_ends_with_how_many_results_there_are_and_how_to_get_the_others() -> None:
    outcomes = {verdict_cell("a"): CellOutcome(Status.OK)}
    summary = Summary(outcomes, (), (), (verdict_cell("b"),))
    section = sweep.section(outcomes, summary)
    assert section.conclusions[0].text == "1 result stored, 1 missing"
    (note,) = section.notes
    assert note.endswith("; the same command measures what is missing")
