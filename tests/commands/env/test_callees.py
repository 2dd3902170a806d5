"""What a step calls, found in its source."""

from functools import wraps
from types import SimpleNamespace
from typing import Any

import example_environments as examples
import pytest

from mjbench.commands.env import callees
from mjbench.commands.env.layers import Layer


def layers_by_name(environment: object) -> dict[str, Layer]:
    return {callee.name: callee.layer for callee in callees.find(environment)}


def test_methods_and_functions_of_the_module_are_found_with_their_layers() -> None:
    assert layers_by_name(examples.make()) == {
        "do_simulation": Layer.STEPPING,
        "_get_obs": Layer.OBSERVATION,
        "score": Layer.REWARD,
        "doubled": Layer.INFO,
    }


def test_methods_of_what_an_environment_holds_are_layers_by_name() -> None:
    environment = examples.dm_control()
    owners = {callee.name: callee.owner for callee in callees.find(environment)}
    assert owners["step"] is environment._physics
    assert owners["get_reward"] is environment.task


def test_what_a_callee_calls_is_found_where_its_name_says_its_layer() -> None:
    assert layers_by_name(examples.robosuite())["reward"] == Layer.REWARD


def test_what_a_reset_replaced_is_found_anew() -> None:
    environment = examples.robosuite()
    (before,) = [c.owner for c in callees.find(environment) if c.name == "step1"]
    environment.reset()
    (after,) = [c.owner for c in callees.find(environment) if c.name == "step1"]
    assert before is not after
    assert after is environment.sim


class Derived(examples.Env):
    def step(self, action: Any) -> Any:
        outcome = super().step(action)
        self.log()
        return outcome

    def log(self) -> None:
        pass


def test_a_base_class_that_is_called_is_read_too() -> None:
    assert set(layers_by_name(Derived())) == {
        "log",
        "do_simulation",
        "_get_obs",
        "score",
        "doubled",
    }


def plain_decorator(function: Any) -> Any:
    def inner(*arguments: Any) -> Any:
        return function(*arguments)

    return inner


def wrapping_decorator(function: Any) -> Any:
    @wraps(function)
    def inner(*arguments: Any) -> Any:
        return function(*arguments)

    return inner


class Decorated:
    @plain_decorator
    def step(self, action: Any) -> Any:
        return self._get_obs()

    def _get_obs(self) -> int:
        return 1


class DecoratedTwice:
    @wrapping_decorator
    @plain_decorator
    def step(self, action: Any) -> Any:
        return self._get_obs()

    def _get_obs(self) -> int:
        return 1


@pytest.mark.parametrize("kind", [Decorated, DecoratedTwice])
def test_decorators_hide_nothing(kind: type) -> None:
    assert layers_by_name(kind()) == {"_get_obs": Layer.OBSERVATION}


class Awkward:
    """Calls what cannot be replaced."""

    __slots__ = ("__dict__", "array", "missing", "slotted")

    def __init__(self) -> None:
        self.array = SimpleNamespace(total=len)
        self.slotted = Slotted()

    @property
    def broken(self) -> Any:
        raise RuntimeError("not now")

    def step(self, action: Any) -> Any:
        self.missing.compute()
        self.broken.compute()
        self.slotted.compute()
        self.array.total([1])
        len([1])
        (lambda: 1)()
        return self.step(action)


class Slotted:
    __slots__ = ()

    def compute(self) -> None:
        pass


def test_what_cannot_be_replaced_is_left_out() -> None:
    assert layers_by_name(Awkward()) == {}


def test_an_environment_without_source_has_no_callees() -> None:
    namespace: dict[str, Any] = {}
    exec("class Hidden:\n    def step(self, action):\n        return self._get_obs()", namespace)
    assert layers_by_name(namespace["Hidden"]()) == {}


def test_lines_that_put_information_together_are_recognised() -> None:
    assert callees.builds_info(examples.make())
    assert not callees.builds_info(examples.dm_control())
