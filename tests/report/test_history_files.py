"""Which histories run files hold: one of each machine."""

import dataclasses
from collections.abc import Sequence

import pytest
from set_files import labelled
from speed_histories import history_run

from benchmarks.history import files, page
from benchmarks.history.release_ratios import OperationRatioRecord, RatioRecord, StepRatioRecord
from benchmarks.history.speed_history import SpeedHistory
from mjbench.errors import InputError
from mjbench.store.runs import SCHEMA, Run, RunHeader

FLAT = [1.0] * 8
STEP = [1.0] * 4 + [1.1] * 4


def histories(**ratios: Sequence[float]) -> list[SpeedHistory]:
    return files.of_runs([history_run(name, values) for name, values in ratios.items()], None)


def test_each_machine_has_a_history_of_its_own() -> None:
    each = histories(a=STEP, b=FLAT)
    assert [one.name for one in each] == ["a", "b"]
    assert [len(one.models[0].changes.change_points) for one in each] == [1, 0]


def operations_run(machine: str, cpu: str, ratios: Sequence[float]) -> Run:
    """Return a run of `history measure --no-steps`."""
    labels = dataclasses.replace(labelled(machine), cpu=cpu)
    records = [
        OperationRatioRecord(
            **{f.name: getattr(step, f.name) for f in dataclasses.fields(RatioRecord)},
            operation="load pile",
            title="load",
        )
        for step in history_run(machine, ratios).of_type(StepRatioRecord)
    ]
    return Run(RunHeader(SCHEMA, "history", labels, {}), tuple(records))


def test_operations_of_a_machine_without_steps_join_the_histories_that_have_none() -> None:
    (only,) = files.of_runs([operations_run("b", "another", STEP), history_run("a", FLAT)], None)
    assert only.name == "a"
    assert [series.name for series in only.operations] == ["load pile"]
    overview, *_ = page.sections(only)
    assert "(operations on another, " in overview.notes[0]
    own = operations_run("a", labelled("a").cpu, FLAT)
    each = files.of_runs([history_run("a", FLAT), own, operations_run("b", "another", STEP)], None)
    assert [one.name for one in each] == ["a"]
    assert each[0].operations_machine is None
    assert not each[0].operations[0].changes.change_points


def test_operations_alone_are_no_history() -> None:
    with pytest.raises(InputError, match="no times of steps"):
        files.of_runs([operations_run("b", "another", STEP)], None)


def test_a_machine_is_chosen_by_its_name() -> None:
    each = histories(a=STEP, b=FLAT)
    assert files.choose(each, "b") is each[1]
    assert files.choose(each[:1], None) is each[0]
    with pytest.raises(InputError, match="give --machine NAME"):
        files.choose(each, None)
    with pytest.raises(InputError, match="no machine x"):
        files.choose(each[:1], "x")
