"""Passes over the recorded actions."""

import random
from collections.abc import Iterator
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import example_environments as examples
import numpy as np
import pytest

from mjbench.commands.env.adapters import adapt
from mjbench.commands.env.layers import Layer
from mjbench.commands.env.passes import LEAST_ROUNDS, EnvironmentPasses, time_rounds
from mjbench.errors import InputError
from mjbench.measuring import timing
from mjbench.simulation import engine_functions


def passes(environment: Any, nstep: int = 40) -> EnvironmentPasses:
    adapter = adapt(environment)
    return EnvironmentPasses(adapter, adapter.draw_actions(nstep, 0), 0)


def test_a_round_that_is_not_sent_may_be_the_longest_so_far(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def block_s(contender: timing.Contender, clock: timing.Clock | None = None) -> float:
        contender.run()
        return 60.0

    monkeypatch.setattr(timing, "block_s", block_s)
    sent: list[object] = []
    channel: Any = SimpleNamespace(allow_silence=lambda seconds: None)
    time_rounds(lambda: "round", sent.append, 30.0, channel)
    assert sent == ["round"] * LEAST_ROUNDS


def test_a_pass_has_the_times_of_steps_and_resets() -> None:
    times = passes(examples.make()).plain()
    assert times.step_ns.shape == (40,)
    assert (times.step_ns > 0).all()
    assert len(times.reset_ns) == 3
    assert times.lengths == [15, 15]


def test_a_step_takes_a_nanosecond_by_a_clock_that_does_not_see_it() -> None:
    times = replace(passes(examples.make()), clock_ns=lambda: 0).plain()
    assert {*times.step_ns, *times.reset_ns} == {1}


def differing(one: EnvironmentPasses, other: EnvironmentPasses) -> list[str]:
    """Return the fields that two passes returned other values of."""
    return list(map(str, one.plain().returned.differences(other.plain().returned)))


def test_passes_return_the_same_and_with_other_actions_something_else() -> None:
    environment = examples.make()
    same, fewer = passes(environment), passes(environment, 39)
    assert differing(same, same) == []
    assert differing(same, fewer)
    adapter = adapt(environment)
    other = EnvironmentPasses(adapter, adapter.draw_actions(40, 1), 0)
    assert differing(same, other) == ["observation[7, 14]", "reward"]


def test_a_clock_in_info_is_not_compared() -> None:
    timed = passes(examples.Timed())
    assert differing(timed, timed) == []


@pytest.mark.parametrize(
    ("environment", "layers"),
    [
        (
            examples.wrapped(),
            {
                (Layer.WRAPPERS, "Outer"): 1,
                (Layer.WRAPPERS, "Wrapper"): 1,
                (Layer.REST, "lines of Env.step, with info"): 1,
                (Layer.STEPPING, "do_simulation"): 1,
                (Layer.PHYSICS, "mj_step"): 1,
                (Layer.ENGINE, "mj_rnePostConstraint"): 1,
                (Layer.OBSERVATION, "_get_obs"): 1,
                (Layer.REWARD, "score"): 1,
                (Layer.INFO, "doubled"): 1,
            },
        ),
        (
            examples.robosuite(),
            {
                (Layer.REST, "lines of RobosuiteEnv.step"): 1,
                (Layer.STEPPING, "step1"): 4,
                (Layer.STEPPING, "step2"): 4,
                (Layer.ACTION, "_pre_action"): 4,
                (Layer.PHYSICS, "mj_step1"): 4,
                (Layer.PHYSICS, "mj_step2"): 4,
                (Layer.INFO, "_post_action"): 1,
                (Layer.REWARD, "reward"): 1,
            },
        ),
    ],
    ids=["gymnasium", "robosuite"],
)
def test_layers_are_timed_beside_a_plain_pass(
    environment: Any, layers: dict[tuple[Layer, str], int]
) -> None:
    both = passes(environment)
    plain, layered = both.side_by_side(engine_functions.bindings(), random.Random(0))
    assert layered.lengths == plain.lengths == both.plain().lengths
    called = {(t.layer, t.name): t.calls for t in layered.layers}
    assert called == layers
    assert sum(t.ns[0] for t in layered.layers) == pytest.approx(layered.step_ns.mean())


class SlowObservation(examples.Env):
    """Planted: nearly all of its time goes to its observation, by the clock of the test."""

    now_ns = 0

    def _get_obs(self) -> np.ndarray:
        SlowObservation.now_ns += 900
        return super()._get_obs()

    def do_simulation(self, action: np.ndarray) -> None:
        SlowObservation.now_ns += 100
        super().do_simulation(action)


def test_a_planted_slow_observation_has_its_time() -> None:
    environment = SlowObservation()
    adapter = adapt(environment)
    slow = EnvironmentPasses(
        adapter, adapter.draw_actions(10, 0), 0, clock_ns=lambda: SlowObservation.now_ns
    )
    plain, layered = slow.side_by_side([], random.Random(0))
    ns = {t.layer: t.ns for t in layered.layers if any(t.ns)}
    assert ns == {Layer.OBSERVATION: [900], Layer.STEPPING: [100]}
    assert plain.step_ns.tolist() == [1000] * 10
    assert plain.reset_ns == [900]


class SlowWrapper(examples.Wrapper):
    """Planted: takes time before and after the step inside it."""

    def __init__(self, environment: Any, ns: int):
        super().__init__(environment)
        self._ns = ns

    def step(self, action: np.ndarray) -> Any:
        SlowObservation.now_ns += self._ns
        outcome = super().step(action)
        SlowObservation.now_ns += self._ns
        return outcome


def test_each_wrapper_has_its_own_time_without_what_is_inside() -> None:
    environment = SlowWrapper(examples.Outer(SlowWrapper(SlowObservation(), 7)), 20)
    adapter = adapt(environment)
    slow = EnvironmentPasses(
        adapter, adapter.draw_actions(10, 0), 0, clock_ns=lambda: SlowObservation.now_ns
    )
    _, layered = slow.side_by_side([], random.Random(0))
    ns = {t.name: t.ns for t in layered.layers if t.layer == Layer.WRAPPERS}
    assert ns == {"SlowWrapper 1": [40], "Outer": [0], "SlowWrapper 2": [14]}


def test_what_a_step_raises_names_its_line() -> None:
    with pytest.raises(InputError, match=r"its step raised KeyError: .*example_environments\.py:"):
        passes(examples.Raises()).plain()
    with pytest.raises(InputError, match="its step raised SystemExit: 4"):
        passes(examples.Exits()).plain()
    with pytest.raises(InputError, match="its step returned NoneType"):
        passes(examples.ReturnsNothing()).plain()


def test_functions_are_put_back_after_a_step_that_raises() -> None:
    environment = examples.Raises()
    before = set(vars(environment))
    with pytest.raises(InputError):
        passes(environment).side_by_side([], random.Random(0))
    assert set(vars(environment)) == before


def test_a_sign_of_life_follows_every_step() -> None:
    signs: Iterator[int] = iter(range(1000))
    passes(examples.make()).plain(lambda: next(signs) and None)
    assert next(signs) == 40
