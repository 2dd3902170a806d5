"""Two runs held against each other."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import pytest
from example_records import measurement, model_record

from mjbench.commands.show.run_differences import RunDifference, differences
from mjbench.host import machine
from mjbench.paths.accelerated import CPU
from mjbench.results.runs import SCHEMA, Run, RunHeader
from mjbench.simulation.accelerated_judgement import Precision
from mjbench.status import Status

MACHINE = replace(machine.describe(), cpu="c", versions={"jax": "1"}, flags={})


def run(jax: str = "1", model: Mapping[str, Any] | None = None, **fields: Any) -> Run:
    header = RunHeader(SCHEMA, "compare", replace(MACHINE, versions={"jax": jax}), {})
    accelerated = {"path": "mjx", "precision": Precision.FLOAT32, "device": CPU}
    record = measurement(**{"samples_s": [1.0] * 9, **accelerated, **fields})
    return Run(header, (model_record(**(model or {})), record))


def difference(old: Run, new: Run, across: bool = False) -> RunDifference:
    (row,) = differences(old, new, across)
    return row


def test_the_ratio_is_new_time_of_a_step_over_old() -> None:
    row = difference(run(), run(samples_s=[1.5] * 9))
    assert row.ratio is not None
    assert row.ratio.estimate == pytest.approx(1.5)
    half_the_steps = difference(run(), run(samples_s=[1.5] * 9, model={"nstep": 200}))
    assert half_the_steps.ratio is not None
    assert half_the_steps.ratio.estimate == pytest.approx(0.75)


def test_runs_of_another_jax_are_compared_only_when_asked() -> None:
    refused = difference(run("1"), run("2"))
    assert (refused.status, refused.ratio) == (Status.INPUT, None)
    assert "they differ in jax (2, 1)" in refused.detail
    assert difference(run("1"), run("2"), across=True).ratio is not None


def test_other_work_is_never_compared() -> None:
    row = difference(run(), run(model={"workload_digest": "other"}), across=True)
    assert row.status == Status.INPUT
    assert "workloads differ" in row.detail


def test_rows_that_only_one_run_has_are_left_out() -> None:
    assert differences(run(), run(path="mjx64"), across=True) == []
    assert differences(run(), run(status=Status.FAILED), across=True) == []
