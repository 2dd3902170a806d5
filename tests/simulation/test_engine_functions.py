"""MuJoCo's functions are replaced while a block runs, and are back afterwards."""

import example_environments as examples
import mujoco
import pytest

from mjbench.simulation import engine_functions


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


def test_blocks_that_do_not_nest_each_see_their_own_calls():
    seen = {"a": 0, "b": 0}

    def counting(name):
        def wrap(function):
            def call(*args):
                seen[name] += 1
                return function(*args)

            return call

        return {"mj_step": wrap}

    model = mujoco.MjModel.from_xml_string("<mujoco/>")
    data, original = mujoco.MjData(model), mujoco.mj_step
    a, b = (engine_functions.replaced(counting(name)) for name in ("a", "b"))
    a.__enter__()
    mujoco.mj_step(model, data)
    b.__enter__()
    mujoco.mj_step(model, data)
    a.__exit__(None, None, None)
    mujoco.mj_step(model, data)
    assert engine_functions.original("mj_step") is original
    b.__exit__(None, None, None)
    assert seen == {"a": 2, "b": 2}
    assert mujoco.mj_step is original
    assert data.time == pytest.approx(3 * model.opt.timestep)


def test_names_bound_by_an_import_are_found():
    assert {"mj_step", "mj_step1", "mj_forward"} <= set(engine_functions.names())
    held = [b for b in engine_functions.bindings() if b.module is examples]
    assert [(b.attribute, b.function) for b in held] == [
        ("mj_rnePostConstraint", "mj_rnePostConstraint")
    ]


def test_calls_by_names_bound_elsewhere_reach_the_replacement():
    calls = []

    def noting(name):
        def wrap(function):
            def call(*arguments, **keywords):
                calls.append(name)
                return function(*arguments, **keywords)

            return call

        return wrap

    names = ["mj_step", "mj_rnePostConstraint", "mj_not_in_this_release"]
    original = mujoco.mj_step, examples.mj_rnePostConstraint
    environment = examples.make()
    environment.reset(seed=0)
    wrappers = {name: noting(name) for name in names}
    with engine_functions.replaced(wrappers, engine_functions.bindings()):
        environment.step([0.0])
    assert calls == ["mj_step", "mj_rnePostConstraint"]
    environment.step([0.0])
    assert calls == ["mj_step", "mj_rnePostConstraint"]
    assert (mujoco.mj_step, examples.mj_rnePostConstraint) == original
