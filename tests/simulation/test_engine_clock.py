"""The engine's clock off and on again: the same states, and no times in between."""

import mujoco
import numpy as np
import pytest
from example_models import CONTACT_XML

import mjbench
from mjbench.simulation import compat


@pytest.fixture
def model() -> mujoco.MjModel:
    model = mujoco.MjModel.from_xml_string(CONTACT_XML)
    if not compat.has_clock(model):
        pytest.skip("this release of MuJoCo has no clock of its own")
    return model


def final_state(model: mujoco.MjModel) -> np.ndarray:
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 20)
    return np.concatenate([data.qpos, data.qvel, data.qacc_warmstart])


def test_steps_end_in_the_same_state_without_it(model: mujoco.MjModel) -> None:
    expected = final_state(model)
    with mjbench.engine_clock(False):
        np.testing.assert_array_equal(final_state(model), expected)


def test_it_is_set_back_at_the_end_of_the_block(model: mujoco.MjModel) -> None:
    with mjbench.engine_clock(False):
        assert mujoco.get_mjcb_time() is not None
    assert mujoco.get_mjcb_time() is None
    assert compat.has_clock(model)


def test_a_call_lasts_until_the_next(model: mujoco.MjModel) -> None:
    mjbench.engine_clock(False)
    assert mujoco.get_mjcb_time() is not None
    mjbench.engine_clock(True)
    assert mujoco.get_mjcb_time() is None


def test_a_clock_of_the_users_own_is_set_back(model: mujoco.MjModel) -> None:
    calls = []

    def clock() -> float:
        calls.append(1)
        return 0.0

    mujoco.set_mjcb_time(clock)
    try:
        with mjbench.engine_clock(False):
            final_state(model)
        assert calls == []
        final_state(model)
        assert calls
    finally:
        mujoco.set_mjcb_time(None)
