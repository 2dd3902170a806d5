"""Which histories run files hold: one of each machine."""

import dataclasses
from collections.abc import Sequence

import pytest
from set_files import labelled
from speed_histories import history_run

from mjbench.errors import InputError
from mjbench.releases.release_ratios import OperationRatioRecord, RatioRecord, StepRatioRecord
from mjbench.report import history, history_files
from mjbench.report.speed_history import SpeedHistory
from mjbench.store.runs import SCHEMA, Run, RunHeader

FLAT = [1.0] * 8
STEP = [1.0] * 4 + [1.1] * 4


def histories(**ratios: Sequence[float]) -> list[SpeedHistory]:
    return history_files.of_runs(
        [history_run(name, values) for name, values in ratios.items()], None
    )


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
    (only,) = history_files.of_runs(
        [operations_run("b", "another", STEP), history_run("a", FLAT)], None
    )
    assert only.name == "a"
    assert [series.name for series in only.operations] == ["load pile"]
    overview, *_ = history.sections(only)
    assert "(operations on another, " in overview.notes[0]
    own = operations_run("a", labelled("a").cpu, FLAT)
    each = history_files.of_runs(
        [history_run("a", FLAT), own, operations_run("b", "another", STEP)], None
    )
    assert [one.name for one in each] == ["a"]
    assert each[0].operations_machine is None
    assert not each[0].operations[0].changes.change_points


def test_operations_alone_are_no_history() -> None:
    with pytest.raises(InputError, match="no times of steps"):
        history_files.of_runs([operations_run("b", "another", STEP)], None)


def test_a_machine_is_chosen_by_its_name() -> None:
    each = histories(a=STEP, b=FLAT)
    assert history_files.choose(each, "b") is each[1]
    assert history_files.choose(each[:1], None) is each[0]
    with pytest.raises(InputError, match="give --machine NAME"):
        history_files.choose(each, None)
    with pytest.raises(InputError, match="no machine x"):
        history_files.choose(each[:1], "x")
