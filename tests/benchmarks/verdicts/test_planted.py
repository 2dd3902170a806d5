"""Planted slowdowns: a longer block, or a function of the engine as control callback."""

import time
from collections.abc import Iterator
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from paired_examples import BRIEF, CARTPOLE, CUBES, INSTALLED

from benchmarks.verdicts import planted
from mjbench.errors import InputError
from mjbench.host.child_connection import ChildError
from mjbench.paired import verdict
from mjbench.paired.loop_sections import LoopSection
from mjbench.paired.run_sizes import Sizes
from mjbench.paired.worker import Worker
from mjbench.paired.worker_pool import WorkerPool
from mjbench.releases.moved_install import ImmovableError
from mjbench.releases.placement import Placement
from mjbench.simulation import models, reference_run, workload
from mjbench.simulation.starts import KEYFRAME_STARTS
from mjbench.simulation.workload_sampling import SampleRequest
from mjbench.status import Status


@pytest.fixture(autouse=True)
def _no_callback_afterwards() -> Iterator[None]:
    yield
    mujoco.set_mjcb_control(None)


@pytest.fixture(scope="module")
def humanoid() -> mujoco.MjModel:
    return models.load(models.resolve("humanoid"))


def test_a_step_calls_the_function(humanoid: mujoco.MjModel) -> None:
    """Without a sensor of it, no step computes the velocity of subtrees."""
    plain, called, expected = (mujoco.MjData(humanoid) for _ in range(3))
    for data in (plain, called, expected):
        data.qvel[:] = np.linspace(-1, 1, humanoid.nv)
    mujoco.mj_forward(humanoid, expected)
    mujoco.mj_subtreeVel(humanoid, expected)
    mujoco.mj_step(humanoid, plain)
    planted.install_callback(humanoid, "mj_subtreeVel")
    mujoco.mj_step(humanoid, called)
    assert not plain.subtree_angmom.any()
    assert expected.subtree_angmom.any()
    assert np.array_equal(called.subtree_angmom, expected.subtree_angmom)


@pytest.mark.parametrize("function", planted.FUNCTIONS)
@pytest.mark.parametrize("name", ["humanoid", "muscle_arm", "linkage"])
def test_no_declared_function_changes_where_a_run_ends(name: str, function: str) -> None:
    model = models.load(models.resolve(name))
    sample = workload.make(model, nbatch=1, nstep=20)
    expected = reference_run.observe(sample).final_state
    planted.install_callback(model, function)
    assert np.array_equal(reference_run.observe(sample).final_state, expected)


def test_a_function_that_this_release_does_not_have_is_bad_input(humanoid: mujoco.MjModel) -> None:
    with pytest.raises(InputError, match="has no function mj_unheardOf"):
        planted.install_callback(humanoid, "mj_unheardOf")


def test_a_model_whose_steps_call_no_callback_is_bad_input() -> None:
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><option><flag actuation='disable'/></option></mujoco>"
    )
    with pytest.raises(InputError, match="the model disables actuation"):
        planted.install_callback(model, "mj_factorM")


def test_a_slowed_section_lasts_longer_by_the_share_asked_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """1000 ns of an injected clock pass in the section, and 3 ns between two looks at it."""
    readings = iter([0, 1000, *range(1003, 1100, 3)])
    monkeypatch.setattr(time, "perf_counter_ns", lambda: next(readings))
    slowed = planted.slowed_section(LoopSection(lambda: None), 0.01)
    slowed.run()
    assert next(readings) > 1010
    assert slowed.reading is not None
    assert slowed.reading() == 1010


@pytest.mark.parametrize("placement", [None, Placement(16, 32)], ids=["as shipped", "moved"])
def test_steps_call_a_function_of_the_engine_that_they_step_with(
    pool: WorkerPool, placement: Placement | None
) -> None:
    """One that does not change states passes the check of final states; one that does fails it."""
    try:
        process = pool.start(INSTALLED, placement=placement)
    except ImmovableError as error:
        pytest.skip(str(error))
    model_file = pool.new_file(".mjb")
    process.wait()
    process.call(Worker.load_model, CUBES.model.name, CUBES.model.path, {})
    process.call(Worker.save_model, model_file)
    workload = process.call(Worker.make_workload, SampleRequest(nbatch=2, nstep=3)).workload
    observed = process.call(Worker.observe, pool.save(workload))
    workload = workload.only(np.arange(2), observed.final_state)
    process.call(Worker.equip, model_file, pool.save(workload), "python_loop")

    def prepare(callback: str) -> int:
        task = planted.slowed_run(callback=callback)
        return process.call(task, "python_loop", {}, (), (0, 1))

    assert prepare("mj_factorM") > 0
    with pytest.raises(ChildError, match="path python_loop does not reach the final states"):
        prepare("mj_Euler")
    pool.end([process])


def test_a_known_slowdown_is_a_share_of_the_simulations(pool: WorkerPool) -> None:
    candidate = replace(CARTPOLE, prepare_run=planted.slowed_run(1.0))
    plan = replace(BRIEF, sizes=Sizes(4, 50, starts=KEYFRAME_STARTS))
    result = verdict.decide_pair(pool, CARTPOLE, candidate, plan)
    assert result.status == Status.OK
    assert result.ratio.estimate > 1.5  # twice the work
