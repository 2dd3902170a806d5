"""MuJoCo's functions are replaced while a block runs, and are back afterwards."""

import mujoco
import pytest

from mjbench.loop import engine_functions


def test_calls_reach_the_replacement_while_the_block_runs():
    calls = []

    def counting(function):
        def call(*args):
            calls.append(function)
            return function(*args)

        return call

    model = mujoco.MjModel.from_xml_string("<mujoco/>")
    data, original = mujoco.MjData(model), mujoco.mj_step
    with engine_functions.replaced({"mj_step": counting, "mj_no_such_function": counting}):
        mujoco.mj_step(model, data)
    assert calls == [original]
    assert mujoco.mj_step is original
    assert data.time == model.opt.timestep


def test_functions_are_back_after_an_exception():
    original = mujoco.mj_step
    with (
        pytest.raises(RuntimeError, match="the program's own"),
        engine_functions.replaced({"mj_step": lambda function: lambda *args: None}),
    ):
        raise RuntimeError("the program's own")
    assert mujoco.mj_step is original
