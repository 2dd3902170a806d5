"""Functions of the engine as control callback: steps call them, and end where they did."""

from collections.abc import Iterator

import mujoco
import numpy as np
import pytest

from mjbench.errors import InputError
from mjbench.simulation import engine_library, models, reference_run, workload


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
    engine_library.install_callback(humanoid, "mj_subtreeVel")
    mujoco.mj_step(humanoid, called)
    assert not plain.subtree_angmom.any()
    assert expected.subtree_angmom.any()
    assert np.array_equal(called.subtree_angmom, expected.subtree_angmom)


@pytest.mark.parametrize("function", engine_library.FUNCTIONS)
@pytest.mark.parametrize("name", ["humanoid", "muscle_arm", "linkage"])
def test_no_declared_function_changes_where_a_run_ends(name: str, function: str) -> None:
    model = models.load(models.resolve(name))
    sample = workload.make(model, nbatch=1, nstep=20)
    expected = reference_run.observe(sample).final_state
    engine_library.install_callback(model, function)
    assert np.array_equal(reference_run.observe(sample).final_state, expected)


def test_a_function_that_this_release_does_not_have_is_bad_input(humanoid: mujoco.MjModel) -> None:
    with pytest.raises(InputError, match="has no function mj_unheardOf"):
        engine_library.install_callback(humanoid, "mj_unheardOf")


def test_a_model_whose_steps_call_no_callback_is_bad_input() -> None:
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><option><flag actuation='disable'/></option></mujoco>"
    )
    with pytest.raises(InputError, match="the model disables actuation"):
        engine_library.install_callback(model, "mj_factorM")
