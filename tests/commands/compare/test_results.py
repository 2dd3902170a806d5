"""Results are derived from records; here the records are invented and the truth is known."""

import dataclasses
import math
from typing import Any

import pytest
from example_races import BATCH_STEP, ROLLOUT, THREADS, compared, derived, raced
from example_records import FACTS, measurement, model_record

from mjbench import formats
from mjbench.commands.compare import results as path_speedups
from mjbench.commands.compare import show as comparison
from mjbench.commands.compare.results import Cores, ModelResults
from mjbench.results import terminal
from mjbench.simulation.accelerated_judgement import Precision
from mjbench.simulation.reference_run import Work
from mjbench.status import Status
from mjbench.verification.plan import Variant
from mjbench.verification.records import ModelRecord, VariantRecord


def printed(model_results: ModelResults) -> str:
    return terminal.text_of([comparison.model_section([model_results])])


def test_speeds_are_those_of_the_plain_loop_times_the_speed_up() -> None:
    model_results = derived(raced())
    base, *others = model_results.results
    assert base.step_ns == pytest.approx(1000, rel=0.01)
    assert base.realtime_factor == pytest.approx(2000, rel=0.01)
    for result in others:
        assert base.step_ns is not None
        assert result.speedup is not None
        assert result.step_ns == pytest.approx(base.step_ns / result.speedup.estimate)
        assert result.rate_over(base) == pytest.approx(result.speedup.estimate)


def test_what_won_has_its_speed_up_from_the_launches_after_the_race() -> None:
    record = raced()
    launches = {str(result.variant): result.launches for result in derived(record).results}
    final = sum(launch.is_final for launch in record.launches)
    assert launches[str(ROLLOUT)] == launches[str(BATCH_STEP)] == final
    assert launches[str(THREADS)] == len(record.launches) - final


@pytest.mark.parametrize("timestep", [0.0, -0.002, math.nan, math.inf])
def test_a_stored_timestep_by_which_no_time_passes_gives_no_real_time_factor(
    timestep: float,
) -> None:
    model_results = derived(raced(), facts=dataclasses.replace(FACTS, timestep=timestep))
    assert {result.realtime_factor for result in model_results.results} == {None}
    assert "✓  rollout threads=2 pool=kept" in printed(model_results)


@pytest.mark.parametrize(
    "row", [{"agrees": False, "status": Status.DISAGREES}, {"status": Status.CRASHED}]
)
def test_a_path_that_disagrees_or_failed_has_no_speed(row: dict[str, Any]) -> None:
    record = raced()
    model, base, rollout, *_ = compared(record)
    assert isinstance(model, ModelRecord)
    assert isinstance(base, VariantRecord)
    assert isinstance(rollout, VariantRecord)
    rows = [base, dataclasses.replace(rollout, **row)]
    result = path_speedups.ModelResults(model, rows, record).results[1]
    assert result.step_ns is result.speedup is result.steps_per_s is None


@pytest.mark.parametrize(
    ("can_fall", "contacts", "is_warned"),
    [(True, 0.0, True), (True, 2.0, False), (False, 0.0, False), (None, 0.0, False)],
)
def test_a_model_in_free_fall_gets_a_warning(
    can_fall: bool | None, contacts: float, is_warned: bool
) -> None:
    facts = dataclasses.replace(FACTS, can_fall=can_fall)
    work = Work(contacts, 0.0, 0.0)
    text = printed(derived(raced(), facts=facts, work=work))
    assert text.startswith("Warning: a free body falls") == is_warned


def test_a_summary_names_models_by_their_files_where_that_is_clear() -> None:
    names = ["a/ant.xml", "b/ant.xml", "b/dog.xml", "cartpole"]
    assert list(formats.short_names(names).values()) == [*names[:2], "dog.xml", "cartpole"]


def test_break_even_counts_the_steps_that_pay_for_compiling() -> None:
    compiled = {"precision": Precision.FLOAT32, "trace_s": 1.0, "compile_s": 3.0}
    rows = [
        measurement(path=path, samples_s=[seconds] * 7, **compiled)
        for path, seconds in (("mjx", 0.0005), ("warp", 0.0015))
    ]
    # the plain loop takes 1 µs a step: a block of 1000 saves 0.5 ms, and 4 s are 8000 blocks
    fast, slow = path_speedups.ModelResults(model_record(), rows, raced()).results
    assert fast.overtakes_after_steps == pytest.approx(8_000_000, rel=0.01)
    assert slow.overtakes_after_steps is None


def test_the_cores_a_run_had_are_the_median_of_its_calibrations() -> None:
    assert derived(raced(cores=1.9)).cores == Cores(1.9, 2)
    assert path_speedups.ModelResults(model_record(), [], None).cores is None


def test_each_launch_is_judged_by_the_threads_of_the_paths_that_it_timed() -> None:
    many = Variant("rollout", {"threads": 16})
    record = raced([(BATCH_STEP, 3.0), (many, 1.5)])
    launches = [
        dataclasses.replace(launch, cores=15.5 if 2 in launch.variants else 1.9)
        for launch in record.launches
    ]
    record = dataclasses.replace(record, launches=launches)
    model_results = derived(record, usable_cores=16)
    assert model_results.cores == Cores(1.9, 2), "most launches are of the winner"
    assert model_results.disturbances == []
    assert "Threads had 1.90 of 2 cores (calibration)." in printed(model_results)


@pytest.mark.parametrize(("cores", "is_disturbed"), [(1.7, False), (1.6, True)])
def test_one_threshold_says_that_threads_had_too_few_cores(
    cores: float, is_disturbed: bool
) -> None:
    expected = ["threads had 1.60 of 2 cores"] if is_disturbed else []
    assert derived(raced(cores=cores)).disturbances == expected


def test_too_few_cores_are_said_with_those_that_other_programs_used() -> None:
    record = raced(cores=1.2)
    launches = [dataclasses.replace(each, other_cores=0.8) for each in record.launches]
    record = dataclasses.replace(record, launches=launches)
    clause = "threads had 1.20 of 2 cores (other programs used 0.8)"
    assert derived(record).disturbances == [clause]


def test_a_run_is_derived_model_by_model_and_size_by_size() -> None:
    records = [
        record
        for name, size in [("a", 1), ("a", 2), ("b", 1)]
        for record in (
            model_record(model=name, nbatch_asked=size),
            measurement(model=name, nbatch_asked=size, samples_s=[1.0]),
        )
    ]
    derived_models = path_speedups.derive_all(records)
    assert [(m.model.model, m.model.nbatch_asked, len(m.results)) for m in derived_models] == [
        ("a", 1, 1),
        ("a", 2, 1),
        ("b", 1, 1),
    ]
