"""Functions of the engine, replaced wherever a program holds them."""

from typing import Any

import example_environments as examples
import mujoco

from mjbench.program import environment_engine


def test_names_bound_by_an_import_are_found() -> None:
    names = environment_engine.function_names()
    assert {"mj_step", "mj_step1", "mj_forward"} <= set(names)
    found = [b for b in environment_engine.bindings(names) if b.module is examples]
    assert [(b.attribute, b.function) for b in found] == [
        ("mj_rnePostConstraint", "mj_rnePostConstraint")
    ]


def test_calls_reach_the_replacement_and_later_ones_do_not() -> None:
    calls: list[str] = []

    def noting(name: str) -> Any:
        def wrap(function: Any) -> Any:
            def call(*arguments: Any, **keywords: Any) -> Any:
                calls.append(name)
                return function(*arguments, **keywords)

            return call

        return wrap

    names = ["mj_step", "mj_rnePostConstraint", "mj_not_in_this_release"]
    original = mujoco.mj_step, examples.mj_rnePostConstraint
    environment = examples.make()
    environment.reset(seed=0)
    wrappers = {name: noting(name) for name in names}
    with environment_engine.replaced(wrappers, environment_engine.bindings(names)):
        environment.step([0.0])
    assert calls == ["mj_step", "mj_rnePostConstraint"]
    environment.step([0.0])
    assert calls == ["mj_step", "mj_rnePostConstraint"]
    assert (mujoco.mj_step, examples.mj_rnePostConstraint) == original
