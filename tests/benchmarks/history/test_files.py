"""The history that run files hold: that of one machine."""

import dataclasses
from collections.abc import Sequence

import pytest
from set_files import labelled, run_of
from speed_histories import VERSIONS, history_run, operation_record

from benchmarks.history import files, known_causes, page
from benchmarks.history.speed_history import SpeedHistory
from mjbench.errors import InputError
from mjbench.results.runs import Run

FLAT = [1.0] * 8
STEP = [1.0] * 4 + [1.1] * 4


def history_of(*measured: Run) -> SpeedHistory:
    return files.of_runs(measured, known_causes.FILE)


def operations_run(machine: str, cpu: str, ratios: Sequence[float]) -> Run:
    """Return a run in which only operations were timed."""
    labels = dataclasses.replace(labelled(machine), cpu=cpu)
    records = [operation_record("load pile", *each) for each in zip(VERSIONS, ratios, strict=False)]
    return run_of("history", *records, machine=labels)


def test_steps_of_two_machines_are_no_history() -> None:
    with pytest.raises(InputError, match="several machines: a, b; give the run files of one"):
        history_of(history_run("a", STEP), history_run("b", FLAT))


def test_operations_of_another_machine_join_a_history_that_has_none() -> None:
    elsewhere = operations_run("b", "another", STEP)
    history = history_of(elsewhere, history_run("a", FLAT))
    assert [series.name for series in history.operations] == ["load pile"]
    overview, *_ = page.sections(history)
    assert "(operations on another, " in overview.notes[0]
    own = operations_run("a", labelled("a").cpu, FLAT)
    history = history_of(history_run("a", FLAT), own, elsewhere)
    assert history.operations_machine is None
    assert not history.operations[0].changes.change_points


def test_operations_alone_are_no_history() -> None:
    with pytest.raises(InputError, match="no step was timed"):
        history_of(operations_run("b", "another", STEP))
