"""Which fields of an environment are not the same in another pass."""

from types import SimpleNamespace
from typing import Any

import example_environments as examples
import mujoco
import numpy as np
import pytest

from mjbench.commands.env.adapters import adapt
from mjbench.commands.env.passes import EnvironmentPasses
from mjbench.commands.env.recording import EngineWatch, Recording
from mjbench.commands.env.repetition import Fingerprint, left_by_reset, physics_differences
from mjbench.simulation import compat


def fingerprint(*values: Any) -> Fingerprint:
    of_values = Fingerprint()
    for value in values:
        of_values.add("observation", value)
    return of_values


def differences(values: list[Any], others: list[Any]) -> list[str]:
    return [str(each) for each in fingerprint(*values).differences(fingerprint(*others))]


@pytest.mark.parametrize(
    ("value", "other", "named"),
    [
        (np.zeros(3), np.zeros(3), []),
        (np.zeros(3), np.array([0, 0, 1e-300]), ["observation[2]"]),
        (np.zeros(5), np.array([0.0, 1, 0, 2, 0]), ["observation[1, 3]"]),
        (np.zeros(9), np.arange(9.0), ["8 of 9 entries of observation"]),
        (np.zeros(2, np.float32), np.ones(2, np.float32), ["observation"]),
        (np.zeros(2), np.zeros(3), ["observation"]),
        (0.0, -0.0, ["observation"]),
        (True, False, ["observation"]),
        ("left", "right", ["observation"]),
        (None, 1.0, ["observation"]),
        (np.longdouble(1), np.longdouble(2), ["observation"]),
        ({"arm": 1.0, "eye": 2.0}, {"arm": 1.0, "eye": 3.0}, ["observation['eye']"]),
        ({"\x1b[2J": 1.0}, {"\x1b[2J": 2.0}, ["observation['\\x1b[2J']"]),
        ((1.0, [2.0]), (1.0, [3.0]), ["observation[1][0]"]),
        (object(), object(), []),
    ],
)
def test_fields_and_entries_that_differ_are_named(value: Any, other: Any, named: list[str]) -> None:
    assert differences([value], [other]) == named
    assert differences([value, value], [value, other]) == named


def test_values_count_in_their_order_and_number() -> None:
    assert differences([1.0, 2.0], [2.0, 1.0]) == ["observation"]
    assert differences([0.0], [0.0, 0.0]) == ["observation"]
    assert differences([0.0, 0.0], [-0.0, -0.0]) == ["observation"]


def recorded(environment: Any) -> Recording:
    adapter, watch = adapt(environment), EngineWatch()
    EnvironmentPasses(adapter, adapter.draw_actions(20, 0), 0).recorded(watch, lambda: None)
    return watch.recording()


def test_physics_is_compared_by_field() -> None:
    environment = examples.make()
    assert physics_differences(recorded(environment), recorded(environment)) == []
    unseeded = examples.Unseeded()
    found = physics_differences(recorded(unseeded), recorded(unseeded))
    assert [str(each) for each in found] == ["qpos", "qvel", "qacc_warmstart"]
    assert all(each.is_physics for each in found)


def test_another_number_of_engine_steps_is_a_difference() -> None:
    (found,) = physics_differences(recorded(examples.make()), recorded(examples.Varying()))
    assert str(found) == "the number of engine steps"


def test_what_a_reset_leaves_as_it_was_differs_at_the_begin_of_an_episode() -> None:
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body><joint/><geom size='.1'/></body></worldbody></mujoco>"
    )
    columns = compat.state_columns(model)

    def recording(warmstart: float, qpos: float, follows: bool = False) -> Any:
        start = np.zeros(compat.state_size(model))
        start[columns["qacc_warmstart"]], start[columns["qpos"]] = warmstart, qpos
        step = SimpleNamespace(start=start, follows=follows, entered=frozenset())
        return SimpleNamespace(model=model, steps=[None, step])

    first = recording(0.0, 0.0)
    assert left_by_reset(first, recording(2.0, 1.0)) == ["qacc_warmstart"]
    assert left_by_reset(first, recording(0.0, 1.0)) == [], "a reset draws positions"
    assert left_by_reset(first, recording(2.0, 0.0, follows=True)) == []
