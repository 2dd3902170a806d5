"""Environments of each framework, recognised by their attributes."""

import random
from types import SimpleNamespace
from typing import Any

import example_environments as examples
import numpy as np
import pytest

from mjbench.commands.env import adapters
from mjbench.commands.env.adapters import (
    DmControlAdapter,
    GymnasiumAdapter,
    RobosuiteAdapter,
    adapt,
    draw_uniform,
)
from mjbench.commands.env.layers import Layer
from mjbench.errors import InputError


@pytest.mark.parametrize(
    ("environment", "kind"),
    [
        (examples.make(), GymnasiumAdapter),
        (examples.wrapped(), GymnasiumAdapter),
        (examples.dm_control(), DmControlAdapter),
        (examples.robosuite(), RobosuiteAdapter),
    ],
    ids=["gymnasium", "wrapped", "dm_control", "robosuite"],
)
def test_the_same_seed_gives_the_same_episode(environment: Any, kind: type) -> None:
    adapter = adapt(environment)
    assert type(adapter) is kind
    actions = adapter.draw_actions(15, seed=3)
    assert len(actions) == 15
    assert all((np.abs(action) <= 1).all() for action in actions)

    def episode(seed: int) -> list[float]:
        adapter.resetting(seed)()
        outcomes = [environment.step(action) for action in actions]
        assert [adapter.is_over(outcome) for outcome in outcomes] == [False] * 14 + [True]
        return [adapter.fields(outcome)["reward"] for outcome in outcomes]

    first = episode(7)
    assert episode(7) == first
    assert episode(8) != first


def test_actions_repeat_with_their_seed() -> None:
    adapter = adapt(examples.make())
    drawn = [np.concatenate(adapter.draw_actions(5, seed)) for seed in (1, 1, 2)]
    assert np.array_equal(drawn[0], drawn[1])
    assert not np.array_equal(drawn[0], drawn[2])
    assert drawn[0].dtype == np.float32


def test_an_action_space_that_draws_itself_is_asked() -> None:
    class Space:
        def seed(self, seed: int) -> None:
            self.random = random.Random(seed)

        def sample(self) -> int:
            return self.random.randrange(1000)

    environment = examples.make()
    environment.action_space = Space()  # type: ignore[assignment]
    expected = random.Random(4)
    assert adapt(environment).draw_actions(3, 4) == [expected.randrange(1000) for _ in range(3)]


def test_infinite_bounds_give_finite_actions() -> None:
    (action,) = draw_uniform([-np.inf, -1.0], [np.inf, 1.0], 1, 0)
    assert np.isfinite(action).all()
    with pytest.raises(InputError, match="no action can be drawn"):
        draw_uniform(["left"], ["right"], 1, 0)


def test_wrappers_are_peeled_in_their_order() -> None:
    adapter = adapt(examples.wrapped())
    assert adapter.wrapper_names == ["Outer", "Wrapper"]
    assert isinstance(adapter.core, examples.Env)
    assert [(c.name, c.layer) for c in adapter.inner_steps()] == [
        ("Wrapper", Layer.WRAPPERS),
        ("lines of Env.step, with info", Layer.REST),
    ]
    assert adapter.outermost_layer() == (Layer.WRAPPERS, "Outer")
    assert adapt(examples.make()).outermost_layer()[0] == Layer.REST


def test_wrappers_of_one_class_are_numbered() -> None:
    adapter = adapt(examples.Wrapper(examples.Outer(examples.Wrapper(examples.Env()))))
    assert adapter.outermost_layer() == (Layer.WRAPPERS, "Wrapper 1")
    assert [callee.name for callee in adapter.inner_steps()[:2]] == ["Outer", "Wrapper 2"]


@pytest.mark.parametrize(
    ("environment", "outcome", "fields"),
    [
        (examples.make(), (1, 2.0, True, False, {}), "observation reward terminated truncated"),
        (examples.make(), (1, 2.0, True, {}), "observation reward done"),
        (examples.robosuite(), (1, 2.0, True, {}), "observation reward done"),
        (
            examples.dm_control(),
            examples.TimeStep(examples.Kind.MID, 2.0, {}),
            "observation reward discount step_type",
        ),
    ],
)
def test_what_a_step_returned_has_names_without_info(
    environment: Any, outcome: Any, fields: str
) -> None:
    named = adapt(environment).fields(outcome)
    assert list(named) == fields.split()
    assert named["reward"] == 2.0


def test_a_wrapper_of_itself_ends() -> None:
    environment = examples.wrapped()
    environment.env.env = environment
    assert len(adapters.chain_of(environment)) == 2


class Seedless:
    """Like an environment of Gym before seeds were given to reset."""

    action_space = examples.Box(1)

    def __init__(self) -> None:
        self.seeds: list[int] = []

    def seed(self, seed: int) -> None:
        self.seeds.append(seed)

    def reset(self) -> None:
        pass

    def step(self, action: Any) -> tuple[int, float, bool, dict[str, Any]]:
        return 0, 1.0, True, {}


def test_an_older_interface_is_understood() -> None:
    environment = Seedless()
    adapter = adapt(environment)
    adapter.resetting(5)()
    assert environment.seeds == [5]
    assert adapter.is_over(environment.step(0))


@pytest.mark.parametrize(
    ("environment", "message"),
    [
        (3, "int is no environment: it has no reset"),
        (SimpleNamespace(reset=len), "it has no step"),
        (examples.Actionless(), "it has neither action_space nor action_spec"),
        (
            SimpleNamespace(reset=len, step=len, num_envs=2, single_action_space=1),
            "give a factory that returns one",
        ),
    ],
    ids=["a number", "no step", "no actions", "several"],
)
def test_what_is_no_environment_is_refused(environment: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        adapt(environment)


def test_unknown_actions_are_refused() -> None:
    with pytest.raises(InputError, match="neither sample"):
        adapt(examples.Shapeless()).draw_actions(1, 0)
    environment = examples.dm_control()
    environment.action_spec = lambda: {"arm": 1}  # type: ignore[method-assign,assignment]
    with pytest.raises(InputError, match="no minimum, maximum and shape"):
        adapt(environment).draw_actions(1, 0)


@pytest.mark.parametrize(
    ("environment", "outcome", "message"),
    [
        (examples.make(), None, "returned NoneType, not 4 or 5 values"),
        (examples.make(), (1, 2.0), "returned 2 values, not 4 or 5 values"),
        (examples.robosuite(), (1, 2, 3, 4, 5), "returned 5 values, not 4 values"),
        (examples.dm_control(), (1, 2), r"not a dm_env\.TimeStep"),
    ],
)
def test_a_step_that_returns_something_else_is_refused(
    environment: Any, outcome: Any, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        adapt(environment).is_over(outcome)


def test_versions_are_those_of_the_packages_of_its_classes() -> None:
    versions = adapt(examples.make()).versions()
    assert versions == {}  # the classes are of no package

    class Subclass(np.random.RandomState):
        action_space = 1
        reset = step = len

    assert adapt(Subclass()).versions() == {"numpy": np.__version__}
