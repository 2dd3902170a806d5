"""Stages of the pipeline: each function in one, and their sum the engine's."""

import pytest
from callgrind_dump import DUMP

from mjbench.counts import callgrind
from mjbench.counts.callgrind import CallgrindProfile
from mjbench.counts.stages import instructions_by_stage, stage_of


def test_stages_sum_up_to_the_engine() -> None:
    costs = instructions_by_stage(callgrind.parse(DUMP))
    assert costs["collision"] == 500
    assert costs["solver"] == 300
    assert sum(costs.values()) == 1000
    assert costs["other"] == 200  # mj_step itself, and mj_forward


@pytest.mark.parametrize("name", ["mj_fwdConstraint", "fwdConstraint", "fwdConstraintStage"])
def test_names_of_a_stage_in_different_releases_are_the_same_stage(name: str) -> None:
    assert stage_of(name) == "solver"


def test_functions_of_no_stage_have_none() -> None:
    assert stage_of("mj_step") is stage_of("fwdConstraintOther") is None


def test_a_new_function_between_the_step_and_its_stages_hides_none_of_them() -> None:
    arcs = {
        ("mj_step", "runAll"): 90,
        ("runAll", "mj_collision"): 60,
        ("runAll", "helper"): 20,
        ("mj_collision", "helper"): 10,
        ("helper", "mj_crb"): 25,  # of both callers: nobody knows how much of it is a stage
    }
    costs = instructions_by_stage(CallgrindProfile({"mj_step": 10}, arcs, {}))
    assert costs["collision"] == 60
    assert costs["inertia"] == 0
    assert costs["other"] == 40
