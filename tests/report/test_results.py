"""Results are derived from records; here the records are invented and the truth is known."""

import dataclasses
import io
import math
from typing import Any

import pytest
from example_records import FACTS, measurement, model_record
from rich.console import Console

from mjbench.report import comparison, results, tables
from mjbench.report.results import ModelResults
from mjbench.simulation.accelerated_limits import Precision
from mjbench.simulation.work import Work
from mjbench.status import Status


def derived(**rows: dict[str, Any]) -> ModelResults:
    return results.derive(
        model_record(), [measurement(path=path, **row) for path, row in rows.items()]
    )


def test_speed_follows_from_samples_and_steps() -> None:
    (base,) = derived(python_loop={"samples_s": [0.003, 0.001, 0.002]}).results
    assert base.step_ns == results.StepTime(pytest.approx(2000), pytest.approx(1000))
    assert base.steps_per_s == pytest.approx(5e5)
    assert base.realtime_factor == pytest.approx(1000)
    assert base.speedup is not None
    assert (base.speedup.median, base.speedup.low, base.speedup.high) == (1.0, None, None)


@pytest.mark.parametrize("timestep", [0.0, -0.002, math.nan, math.inf])
def test_a_stored_timestep_by_which_no_time_passes_gives_no_real_time_factor(
    timestep: float,
) -> None:
    facts = dataclasses.replace(FACTS, timestep=timestep)
    model_results = results.derive(model_record(facts=facts), [measurement(samples_s=[0.001])])
    assert model_results.results[0].realtime_factor is None
    out = Console(file=io.StringIO(), width=200)
    comparison.print_model(out, model_results)
    assert "1,000" in out.file.getvalue()  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    "row", [{"agrees": False, "status": Status.DISAGREES}, {"status": Status.CRASHED}]
)
def test_a_path_that_disagrees_or_failed_has_no_speed(row: dict[str, Any]) -> None:
    rows = derived(python_loop={"samples_s": [1.0]}, rollout={"samples_s": [0.5], **row}).results
    assert rows[1].step_ns is rows[1].speedup is rows[1].steps_per_s is None


@pytest.mark.parametrize(
    ("can_fall", "contacts", "is_warned"),
    [(True, 0.0, True), (True, 2.0, False), (False, 0.0, False), (None, 0.0, False)],
)
def test_a_model_in_free_fall_gets_a_warning(
    can_fall: bool | None, contacts: float, is_warned: bool
) -> None:
    facts = dataclasses.replace(FACTS, can_fall=can_fall)
    work = Work(contacts, 0.0, 0.0)
    model_results = results.derive(model_record(facts=facts, work=work, start_contacts=0), [])
    out = Console(file=io.StringIO(), width=200)
    comparison.print_model(out, model_results)
    assert ("these are the speeds of free fall" in out.file.getvalue()) == is_warned  # type: ignore[attr-defined]


def test_a_summary_names_models_by_their_files_where_that_is_clear() -> None:
    names = ["a/ant.xml", "b/ant.xml", "b/dog.xml", "cartpole"]
    assert list(tables.short_names(names).values()) == [*names[:2], "dog.xml", "cartpole"]


def test_break_even_counts_the_steps_that_pay_for_compiling() -> None:
    compiled = {"precision": Precision.FLOAT32, "trace_s": 1.0, "compile_s": 3.0}
    base, fast, slow = derived(
        python_loop={"samples_s": [0.2] * 7},
        mjx={"samples_s": [0.1] * 7, **compiled},
        warp={"samples_s": [0.3] * 7, **compiled},
    ).results
    # a block of 1000 steps saves 0.1 s; 4 s are 40 blocks
    assert fast.overtakes_after_steps == pytest.approx(40_000)
    assert slow.overtakes_after_steps is None
    assert base.overtakes_after_steps is None


def test_the_cores_a_run_had_are_the_median_of_its_calibrations() -> None:
    assert results.derive(model_record(cores_had=[1.5, 1.9]), []).cores_had == pytest.approx(1.7)
    assert results.derive(model_record(cores_had=[]), []).cores_had is None


def test_a_run_is_derived_model_by_model_and_size_by_size() -> None:
    records = [
        record
        for name, size in [("a", 1), ("a", 2), ("b", 1)]
        for record in (
            model_record(model=name, nbatch_asked=size),
            measurement(model=name, nbatch_asked=size, samples_s=[1.0]),
        )
    ]
    derived_models = results.derive_all(records)
    assert [(m.model.model, m.model.nbatch_asked, len(m.results)) for m in derived_models] == [
        ("a", 1, 1),
        ("a", 2, 1),
        ("b", 1, 1),
    ]
