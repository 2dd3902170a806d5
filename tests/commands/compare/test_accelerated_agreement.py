"""What the check of a compiled run refuses, on an engine that is C under another name."""

import copy
import dataclasses
import functools

import mujoco
import pytest
from pretender import MODEL, Pretender, Pretender32, make_workload

from mjbench.commands.compare.accelerated_agreement import (
    CheckedRun,
    Programs,
    check_run,
    probe_workload,
    reordered_end_problem,
    timed_end_problem,
)
from mjbench.paths.accelerated import Compiled
from mjbench.results.runs import to_json
from mjbench.simulation.accelerated_judgement import EngineAnswer, EngineJudgement, PartName
from mjbench.simulation.constraint_problem import converging, without_constraints
from mjbench.simulation.reference_run import Peaks
from mjbench.simulation.workload import Workload


def compiled_run(workload: Workload, wrong: str = "") -> Compiled:
    return Pretender(wrong).compile(workload, {}, Peaks(0, 0))


def checked_run(workload: Workload, path: Pretender) -> CheckedRun:
    def program(steps: Workload) -> Compiled:
        return path.compile(steps, {}, Peaks(0, 0))

    smooth, converged = (
        program(probe_workload(model, workload))
        for model in (without_constraints(workload.model), converging(workload.model))
    )
    return check_run(Programs(program(workload), smooth, converged), path.precision)


@functools.cache
def faultless(path: type[Pretender], model: str) -> CheckedRun:
    """Return the checked run of an engine without a fault."""
    return checked_run(make_workload(model), path())


def judged(workload: Workload, wrong: str = "") -> EngineJudgement:
    return checked_run(workload, Pretender(wrong)).judgement


def failed_parts(judgement: EngineJudgement) -> set[PartName]:
    return {part.name for part in judgement.parts if part.answer == EngineAnswer.NO}


@pytest.mark.parametrize(
    ("wrong", "parts"),
    [
        ("control", {PartName.SMOOTH, PartName.INPUTS}),
        ("start", {PartName.INPUTS}),
        ("nan", {PartName.RUN}),
        ("step", {PartName.SMOOTH}),
        ("forceless", {PartName.SMOOTH}),
    ],
)
def test_a_wrong_engine_is_refused(wrong: str, parts: set[PartName]) -> None:
    assert parts <= failed_parts(judged(make_workload(), wrong))


@pytest.mark.parametrize("wrong", ["still", "nan", "start", "step"])
def test_a_wrong_engine_is_refused_in_contact_too(wrong: str) -> None:
    assert judged(make_workload("humanoid", nstep=10), wrong).answer == EngineAnswer.NO


# A fault of an engine, a model on which it shows, and the part that it makes fail.
FAULTS = (
    ("friction", "cube_table", PartName.CONSTRAINTS),
    ("lost contact", "gripper", PartName.CONTACTS),
    ("contactless", "cube_table", PartName.CONTACTS),
    ("skipped equality", "gripper", PartName.CONSTRAINTS),
    ("force", "cube_table", PartName.CONSTRAINTS),
    ("ignored limit", "humanoid", PartName.CONSTRAINTS),
    ("soft", "cube_table", PartName.CONSTRAINTS),
    ("damping", "gripper", PartName.SMOOTH),
)


@pytest.mark.parametrize("path", [Pretender, Pretender32])
@pytest.mark.parametrize(("wrong", "model", "part"), FAULTS)
def test_a_fault_where_bodies_touch_makes_its_part_fail(
    path: type[Pretender], wrong: str, model: str, part: PartName
) -> None:
    judgement = checked_run(make_workload(model, nstep=10), path(wrong)).judgement
    assert judgement.answer == EngineAnswer.NO
    assert part in failed_parts(judgement), judgement.summary


@pytest.mark.parametrize("path", [Pretender, Pretender32])
@pytest.mark.parametrize("wrong", ["", "warm start"])
def test_an_engine_that_starts_warm_where_the_model_forbids_it_is_refused(
    path: type[Pretender], wrong: str
) -> None:
    workload = make_workload("humanoid")
    cold = copy.copy(workload.model)
    cold.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_WARMSTART)
    judgement = checked_run(dataclasses.replace(workload, model=cold), path(wrong)).judgement
    assert (PartName.WARM_START in failed_parts(judgement)) == bool(wrong), judgement.summary


@pytest.mark.parametrize("path", [Pretender, Pretender32])
@pytest.mark.parametrize("model", ["cartpole", "humanoid", "gripper", "linkage"])
def test_c_itself_agrees_in_float64_and_in_float32(path: type[Pretender], model: str) -> None:
    checked = faultless(path, model)
    assert checked.judgement.answer == EngineAnswer.YES, checked.judgement.summary
    assert checked.final_shadow > 0
    assert bool(checked.judgement.contact_states) == (model in ("humanoid", "gripper"))
    assert to_json(checked.judgement)["answer"] == "yes"


@pytest.mark.parametrize("model", ["cartpole", "cube_table"])
@pytest.mark.parametrize("wrong", ["", "many"])
def test_every_simulation_of_a_large_batch_takes_a_step_that_is_judged(
    wrong: str, model: str
) -> None:
    judgement = judged(make_workload(model, nbatch=300, nstep=4), wrong)
    assert (PartName.SMOOTH in failed_parts(judgement)) == bool(wrong), judgement.summary


@pytest.mark.parametrize("wrong", ["", "idle"])
def test_timed_blocks_that_do_nothing_are_reported_in_contact_on_a_gpu_too(wrong: str) -> None:
    workload = make_workload("humanoid")
    compiled = dataclasses.replace(compiled_run(workload, wrong), is_deterministic=False)
    problem = timed_end_problem(compiled, faultless(Pretender, "humanoid"))
    assert bool(problem) == bool(wrong)


@pytest.mark.parametrize("exact", [True, False])
@pytest.mark.parametrize(("wrong", "problem"), [("", ""), ("block", "timed blocks end")])
def test_a_timed_block_that_ends_elsewhere_than_the_checked_run_is_reported(
    wrong: str, problem: str, exact: bool
) -> None:
    workload = make_workload()
    compiled = dataclasses.replace(compiled_run(workload, wrong), is_deterministic=exact)
    reported = timed_end_problem(compiled, faultless(Pretender, MODEL))
    assert reported.startswith(problem)
    assert bool(reported) == bool(problem)


@pytest.mark.parametrize("model", ["cartpole", "humanoid"])
@pytest.mark.parametrize("wrong", ["", "memo"])
def test_a_block_that_replays_an_earlier_one_is_reported_once_simulations_are_reordered(
    wrong: str, model: str
) -> None:
    workload = make_workload(model)
    compiled, checked = compiled_run(workload, wrong), faultless(Pretender, model)
    assert timed_end_problem(compiled, checked) == ""
    problem = reordered_end_problem(compiled, checked)
    assert problem.startswith("once the simulations are reordered, ") == bool(wrong), problem
