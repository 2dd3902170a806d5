"""What the check of a compiled run refuses, on an engine that is C under another name."""

import dataclasses

import pytest
from pretender import Pretender, make_workload

from mjbench.comparison.accelerated_check import (
    CheckedRun,
    check_run,
    reordered_end_problem,
    timed_end_problem,
)
from mjbench.paths.accelerated import Compiled
from mjbench.simulation import accelerated_limits
from mjbench.simulation.accelerated_limits import Precision
from mjbench.simulation.work import Peaks
from mjbench.simulation.workload import Workload
from mjbench.store.runs import to_json


def compiled_run(workload: Workload, wrong: str = "") -> Compiled:
    return Pretender(wrong).compile(workload, {}, Peaks(0, 0))


def checked_run(workload: Workload, compiled: Compiled) -> CheckedRun:
    return check_run(workload, compiled.advance, Precision.FLOAT64)


def failures(workload: Workload, wrong: str = "") -> list[str]:
    checked = checked_run(workload, compiled_run(workload, wrong))
    return accelerated_limits.failures(checked.check)


@pytest.mark.parametrize(
    ("wrong", "reason"),
    [
        ("control", "unconstrained step differs"),
        ("control", "start states or controls"),
        ("start", "start states or controls"),
        ("nan", "finite"),
        ("step", "unconstrained steps differ"),
        ("forceless", "unconstrained step differs"),
    ],
)
def test_a_wrong_engine_is_refused(wrong: str, reason: str) -> None:
    lines = failures(make_workload(), wrong)
    assert any(reason in line for line in lines), lines


@pytest.mark.parametrize("wrong", ["still", "nan", "start"])
def test_a_wrong_engine_is_refused_in_contact_too(wrong: str) -> None:
    assert failures(make_workload("humanoid"), wrong)


@pytest.mark.parametrize("model", ["humanoid", "cube_table"])
def test_an_engine_that_finds_no_contact_is_refused(model: str) -> None:
    lines = failures(make_workload(model, nstep=100), "contactless")
    assert any("times the impulse that they have in C" in line for line in lines), lines
    assert any("final states penetrate" in line for line in lines), lines


@pytest.mark.parametrize("wrong", ["", "many"])
def test_every_simulation_of_a_large_batch_takes_a_step_that_is_judged(wrong: str) -> None:
    lines = failures(make_workload(nbatch=300, nstep=4), wrong)
    assert any("unconstrained step differs" in line for line in lines) == bool(wrong), lines


@pytest.mark.parametrize("wrong", ["", "idle"])
def test_timed_blocks_that_do_nothing_are_reported_in_contact_on_a_gpu_too(wrong: str) -> None:
    workload = make_workload("humanoid", nbatch=8)
    compiled = dataclasses.replace(compiled_run(workload, wrong), is_deterministic=False)
    problem = timed_end_problem(workload, compiled, checked_run(workload, compiled))
    assert bool(problem) == bool(wrong)


@pytest.mark.parametrize("exact", [True, False])
@pytest.mark.parametrize(("wrong", "problem"), [("", ""), ("block", "timed blocks end")])
def test_a_timed_block_that_ends_elsewhere_than_the_checked_run_is_reported(
    wrong: str, problem: str, exact: bool
) -> None:
    workload = make_workload()
    compiled = dataclasses.replace(compiled_run(workload, wrong), is_deterministic=exact)
    reported = timed_end_problem(workload, compiled, checked_run(workload, compiled))
    assert reported.startswith(problem)
    assert bool(reported) == bool(problem)


@pytest.mark.parametrize("model", ["cartpole", "humanoid"])
@pytest.mark.parametrize("wrong", ["", "memo"])
def test_a_block_that_replays_an_earlier_one_is_reported_once_simulations_are_reordered(
    wrong: str, model: str
) -> None:
    workload = make_workload(model, nbatch=8)
    compiled = compiled_run(workload, wrong)
    checked = checked_run(workload, compiled)
    assert timed_end_problem(workload, compiled, checked) == ""
    problem = reordered_end_problem(workload, compiled, checked)
    assert problem.startswith("once the simulations are reordered, ") == bool(wrong), problem


@pytest.mark.parametrize("model", ["cartpole", "humanoid"])
def test_the_reference_engine_itself_passes(model: str) -> None:
    workload = make_workload(model)
    checked = checked_run(workload, compiled_run(workload))
    check = checked.check
    assert accelerated_limits.failures(check) == []
    assert check.final_difference == 0
    assert check.final_shadow > 0
    assert bool(check.contact_steps) == (model == "humanoid")
    assert to_json(check)["final_nstep"] == workload.nstep
