"""Histories of several machines: on how many each change is listed."""

import dataclasses
from collections.abc import Sequence

import pytest
from set_files import labelled
from speed_histories import VERSIONS, record

from mjbench.errors import InputError
from mjbench.releases.release_ratios import OperationRatioRecord, RatioRecord, StepRatioRecord
from mjbench.report import history_files, speed_across, speed_page
from mjbench.report.history_files import MachineHistory
from mjbench.store.runs import SCHEMA, Run, RunHeader

FLAT = [1.0] * 8
STEP = [1.0] * 4 + [1.1] * 4
DOWN = [1.0] * 4 + [0.9] * 4


def run(machine: str, ratios: Sequence[float], model: str = "pile") -> Run:
    """Return a run of `history measure`."""
    header = RunHeader(SCHEMA, "history", labelled(machine), {})
    records = [record(v, r, model) for v, r in zip(VERSIONS, ratios, strict=False)]
    return Run(header, tuple(records))


def histories(**ratios: Sequence[float]) -> list[MachineHistory]:
    return history_files.of_runs([run(name, values) for name, values in ratios.items()], None)


def test_each_machine_has_a_history_of_its_own() -> None:
    each = histories(a=STEP, b=FLAT)
    assert [one.name for one in each] == ["a", "b"]
    assert [len(one.history.models[0].changes.change_points) for one in each] == [1, 0]


def operations_run(machine: str, cpu: str, ratios: Sequence[float]) -> Run:
    """Return a run of `history measure --no-steps`."""
    labels = dataclasses.replace(labelled(machine), cpu=cpu)
    records = [
        OperationRatioRecord(
            **{f.name: getattr(step, f.name) for f in dataclasses.fields(RatioRecord)},
            operation="load pile",
            title="load",
        )
        for step in run(machine, ratios).of_type(StepRatioRecord)
    ]
    return Run(RunHeader(SCHEMA, "history", labels, {}), tuple(records))


def test_operations_of_a_machine_without_steps_join_the_histories_that_have_none() -> None:
    (only,) = history_files.of_runs([operations_run("b", "another", STEP), run("a", FLAT)], None)
    assert only.name == "a"
    assert [series.name for series in only.history.operations] == ["load pile"]
    page = "\n".join(speed_page.lines(only.history))
    assert "(operations on another, " in page
    own = operations_run("a", labelled("a").cpu, FLAT)
    each = history_files.of_runs([run("a", FLAT), own, operations_run("b", "another", STEP)], None)
    assert [one.name for one in each] == ["a"]
    assert each[0].history.operations_machine is None
    assert not each[0].history.operations[0].changes.change_points


def test_operations_alone_are_no_history() -> None:
    with pytest.raises(InputError, match="no times of steps"):
        history_files.of_runs([operations_run("b", "another", STEP)], None)


def test_a_change_says_on_how_many_machines_it_is_listed() -> None:
    (change,) = speed_across.changes(histories(a=STEP, b=STEP, c=STEP, d=FLAT))
    assert (change.releases, change.count) == ("1.3 → 1.4", "slower on 3 of 4")
    assert [m.cell[:5] for m in change.machines] == ["+10.0", "+10.0", "+10.0", "–"]


def test_machines_that_did_not_measure_both_releases_do_not_count() -> None:
    (change,) = speed_across.changes(histories(a=STEP, b=FLAT[:4], c=FLAT))
    assert change.count == "slower on 1 of 2"
    page = "\n".join(speed_across.lines(histories(a=STEP, b=FLAT[:4], c=FLAT)))
    assert "| 1.3 → 1.4 | `pile` | slower on 1 of 2 | +10.0 ±" in page
    assert "| not measured | – |" in page


def test_directions_are_counted_apart() -> None:
    (change,) = speed_across.changes(histories(a=STEP, b=DOWN))
    assert change.count == "slower on 1, faster on 1 of 2"


def test_the_conclusion_counts_changes_by_machines() -> None:
    each = histories(a=STEP, b=STEP)
    found = speed_across.changes(each)
    assert speed_across.conclusion(each, found) == (
        "1 change is listed on 2 machines: 1 on all machines that measured them."
    )
    each = histories(a=STEP, b=FLAT)
    text = speed_across.conclusion(each, speed_across.changes(each))
    assert text.endswith("1 on one machine alone.")


def test_many_machines_have_a_row_each() -> None:
    each = histories(**{f"m{n}": STEP for n in range(9)})
    lines = list(speed_across.lines(each))
    assert "| releases | what | listed | machine | time |" in lines
    assert (
        sum(line.startswith("| 1.3 → 1.4 | `pile` | slower on 9 of 9 | m") for line in lines) == 9
    )


def test_releases_since_one_are_listed_where_any_machine_measured_it() -> None:
    runs = [run("a", STEP), run("b", FLAT[:2])]
    each = history_files.of_runs(runs, None, since="1.5")
    assert speed_across.changes(each) == []
    with pytest.raises(InputError, match=r"9\.9 was not measured"):
        history_files.of_runs(runs, None, since="9.9")


def test_a_machine_is_chosen_by_its_name() -> None:
    each = histories(a=STEP, b=FLAT)
    assert history_files.choose(each, "b") is each[1].history
    assert history_files.choose(each[:1], None) is each[0].history
    with pytest.raises(InputError, match="give --machine NAME"):
        history_files.choose(each, None)
    with pytest.raises(InputError, match="no machine x"):
        history_files.choose(each[:1], "x")


def test_runs_without_a_host_are_of_the_only_machine_of_their_kind() -> None:
    older = run("", STEP)
    named = run("a", FLAT)
    (only,) = history_files.of_runs([older, named], None)
    assert only.name == "a"
    other = dataclasses.replace(older, header=dataclasses.replace(older.header, command="history"))
    assert len(history_files.of_runs([other], None)) == 1
