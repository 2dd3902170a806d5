"""Time is charged to the layer on top, by a clock of the test's own."""

import dataclasses
import threading
from collections.abc import Iterator
from typing import Any

import pytest
from still_clock import StillClock

from mjbench.commands.env.callees import Callee
from mjbench.commands.env.layers import Layer
from mjbench.commands.env.timer import (
    LayerSamples,
    LayerTimer,
    functions_timed,
    in_all_rounds,
    measure_cost,
)


@pytest.fixture
def clock() -> StillClock:
    return StillClock(100)


def times(timer: LayerTimer) -> dict[str, tuple[float, ...]]:
    return {t.name: (t.calls, t.timed_calls, t.inner_calls, *t.ns) for t in timer.layers()}


def test_layers_exclude_what_they_call_and_add_up_to_the_step(clock: StillClock) -> None:
    timer = LayerTimer(clock)
    engine = timer.timed(lambda: clock.move(70), Layer.PHYSICS, "mj_step")

    def simulate() -> None:
        clock.move(5)
        engine()
        engine()
        clock.move(3)

    simulation = timer.timed(simulate, Layer.STEPPING, "do_simulation")

    def step(action: Any) -> str:
        clock.move(10)
        simulation()
        clock.move(2)
        return f"after {action}"

    run = timer.outermost(step, Layer.REST, "step")
    assert run("left") == ("after left", 160)
    assert times(timer) == {
        "step": (1, 0, 1, 12),
        "do_simulation": (1, 1, 2, 8),
        "mj_step": (2, 2, 0, 140),
    }
    after_one = timer.layers()
    run("right")
    assert sum(t.ns[0] for t in timer.layers()) == 320
    assert sum(t.ns[0] for t in after_one) == 160, "what was returned stays"


def test_calls_outside_of_a_step_and_in_other_threads_are_not_charged(clock: StillClock) -> None:
    timer = LayerTimer(clock)
    engine = timer.timed(lambda: clock.move(70), Layer.PHYSICS, "mj_step")
    engine()

    def step(action: Any) -> None:
        thread = threading.Thread(target=engine)
        thread.start()
        thread.join()

    timer.outermost(step, Layer.REST, "step")(None)
    assert times(timer) == {"step": (1, 0, 0, 70)}


def test_an_exception_passes_and_leaves_the_timer_usable(clock: StillClock) -> None:
    timer = LayerTimer(clock)

    def fail() -> None:
        clock.move(7)
        raise ValueError("no")

    failing = timer.timed(fail, Layer.REWARD, "reward")
    run = timer.outermost(lambda _: failing(), Layer.REST, "step")
    for _ in range(2):
        with pytest.raises(ValueError, match="no"):
            run(None)
    assert times(timer)["reward"] == (2, 2, 0, 14)


def test_functions_of_one_name_and_layer_share_an_entry(clock: StillClock) -> None:
    timer = LayerTimer(clock)
    first = timer.timed(lambda: clock.move(1), Layer.WRAPPERS, "Scale")
    second = timer.timed(lambda: clock.move(2), Layer.WRAPPERS, "Scale")
    timer.outermost(lambda _: (first(), second()), Layer.REST, "step")(None)
    assert times(timer)["Scale"] == (2, 2, 0, 3)


def test_rounds_of_a_function_are_joined_unless_one_lacks_it() -> None:
    def samples(name: str, ns: float) -> LayerSamples:
        return LayerSamples(Layer.REWARD, name, 1.0, 1.0, 0.0, [ns])

    rounds = [samples("reward", 5.0), samples("cost", 1.0), samples("reward", 7.0)]
    assert in_all_rounds(rounds, 2) == [dataclasses.replace(rounds[0], ns=[5.0, 7.0])]


class Owner:
    def __init__(self) -> None:
        self.own = lambda: "own"

    def method(self) -> str:
        return "method"


class Refusing:
    def method(self) -> str:
        return "method"

    def __setattr__(self, name: str, value: object) -> None:
        raise AttributeError("read-only")


def test_functions_are_replaced_and_put_back(clock: StillClock) -> None:
    owner, refusing, timer = Owner(), Refusing(), LayerTimer(clock)
    before = dict(vars(owner))
    callees = [
        Callee(owner, "method", Layer.REST, "method"),
        Callee(owner, "own", Layer.REST, "own"),
        Callee(owner, "absent", Layer.REST, "absent"),
        Callee(refusing, "method", Layer.REST, "refusing"),
    ]
    with functions_timed(timer, callees):
        assert set(vars(owner)) == {"own", "method"}
        run = timer.outermost(lambda _: (owner.method(), owner.own()), Layer.REST, "step")
        assert run(None)[0] == ("method", "own")
    assert vars(owner) == before
    assert times(timer)["own"][0] == times(timer)["method"][0] == 1
    assert "absent" not in times(timer)


def test_a_timed_function_keeps_its_name(clock: StillClock) -> None:
    def reward() -> None:
        """Say how good it is."""

    timed = LayerTimer(clock).timed(reward, Layer.REWARD, "reward")
    assert (timed.__name__, timed.__doc__) == ("reward", "Say how good it is.")


def test_the_cost_is_what_the_timer_adds_inside_and_outside() -> None:
    def readings() -> Iterator[int]:
        # the clock moves by 10 ns whenever it is read, and by nothing else
        now = 0
        while True:
            yield now
            now += 10

    sequence = readings()
    cost = measure_cost(lambda: next(sequence))
    # a timed call reads the clock twice: once before the function, once after it
    assert cost.inside_ns == pytest.approx(10, abs=0.1)
    assert cost.outside_ns == pytest.approx(10, abs=0.1)
    assert cost.total_ns == cost.inside_ns + cost.outside_ns
