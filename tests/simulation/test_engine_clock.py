"""The timer of MuJoCo's Python package, off and on again: the same states, no times in between."""

import contextlib

import mujoco
import numpy as np
import pytest
from commands import python
from example_models import CONTACT_XML

import mjbench
from mjbench.simulation import engine_clock
from mjbench.simulation.engine_clock import has_clock


@pytest.fixture
def model() -> mujoco.MjModel:
    model = mujoco.MjModel.from_xml_string(CONTACT_XML)
    if not has_clock(model):
        pytest.skip("this release of MuJoCo installs no timer")
    return model


def final_state(model: mujoco.MjModel) -> np.ndarray:
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 20)
    return np.concatenate([data.qpos, data.qvel, data.qacc_warmstart])


def test_steps_end_in_the_same_state_without_it(model: mujoco.MjModel) -> None:
    expected = final_state(model)
    with mjbench.engine_clock(False):
        np.testing.assert_array_equal(final_state(model), expected)


def test_no_times_are_stored_until_the_end_of_the_block(model: mujoco.MjModel) -> None:
    with mjbench.engine_clock(False):
        assert not has_clock(model)
    assert has_clock(model)


def test_a_new_mjdata_does_not_install_the_timer_again(model: mujoco.MjModel) -> None:
    with mjbench.engine_clock(False):
        mujoco.MjData(model)
        assert not has_clock(model)


def test_a_call_lasts_until_the_next(model: mujoco.MjModel) -> None:
    mjbench.engine_clock(False)
    mjbench.engine_clock(False)
    assert not has_clock(model)
    with mjbench.engine_clock(True):
        assert has_clock(model)
    assert not has_clock(model)
    mjbench.engine_clock(True)
    assert has_clock(model)


def test_the_last_call_decides_among_blocks_that_have_not_ended(model: mujoco.MjModel) -> None:
    with contextlib.ExitStack() as of_off, contextlib.ExitStack() as of_on:
        of_off.enter_context(mjbench.engine_clock(False))
        of_on.enter_context(mjbench.engine_clock(True))
        assert has_clock(model)
        of_on.close()
        assert not has_clock(model)
    assert has_clock(model)


def test_an_object_can_be_used_for_several_blocks(model: mujoco.MjModel) -> None:
    clock = mjbench.engine_clock(False)
    for _ in range(2):
        with clock:
            assert not has_clock(model)
        assert has_clock(model)


def test_a_timer_that_the_program_sets_in_the_block_stays(model: mujoco.MjModel) -> None:
    try:
        with mjbench.engine_clock(False):
            mujoco.set_mjcb_time(lambda: 0.0)
            own = mujoco.get_mjcb_time()
        final_state(model)
        assert mujoco.get_mjcb_time() is own
        assert not has_clock(model)
    finally:
        mujoco.set_mjcb_time(None)


def test_mujocos_own_call_turns_it_off_without_mjbench() -> None:
    """In a process of its own: MuJoCo's Python package does not offer the way back."""
    program = (
        "import mujoco\n"
        "model = mujoco.MjModel.from_xml_string('<mujoco/>')\n"
        "data = mujoco.MjData(model)\n"
        f"{engine_clock.OFF_SNIPPET}\n"
        "mujoco.mj_step(model, data)\n"
        "print(data.timer[mujoco.mjtTimer.mjTIMER_STEP].duration)\n"
    )
    assert python("-c", program).stdout == "0.0\n"


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
