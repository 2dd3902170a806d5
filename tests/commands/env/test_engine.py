"""Functions of the engine, replaced wherever a program holds them."""

from typing import Any

import example_environments as examples
import mujoco

from mjbench.commands.env import engine


def test_names_bound_by_an_import_are_found() -> None:
    assert {"mj_step", "mj_step1", "mj_forward"} <= set(engine.function_names())
    held = [b for b in engine.bindings() if b.module is examples]
    assert [(b.attribute, b.function) for b in held] == [
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
    with engine.replaced(wrappers, engine.bindings()):
        environment.step([0.0])
    assert calls == ["mj_step", "mj_rnePostConstraint"]
    environment.step([0.0])
    assert calls == ["mj_step", "mj_rnePostConstraint"]
    assert (mujoco.mj_step, examples.mj_rnePostConstraint) == original
