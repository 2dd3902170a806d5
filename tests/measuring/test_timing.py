import random

import numpy as np

from mjbench.measuring import stats, timing


class FakeClock:
    """A clock that moves only when work is done."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


def contender(clock: FakeClock, cost: float, log: list[str], name: str) -> timing.Contender:
    def spend(seconds: float, what: str) -> None:
        clock.now += seconds
        log.append(f"{what} {name}")

    return timing.Contender(
        run=lambda: spend(cost, "run"),
        before=lambda: spend(100.0, "before"),
        after=lambda: spend(100.0, "after"),
    )


def test_only_the_block_itself_is_timed() -> None:
    clock, log = FakeClock(), list[str]()
    assert timing.block_s(contender(clock, 3.0, log, "a"), clock) == 3.0
    assert log == ["before a", "run a", "after a"]


def test_a_clock_that_does_not_see_a_block_leaves_ratios_finite() -> None:
    blind = FakeClock()
    rounds = timing.rounds([timing.Contender(lambda: None)] * 2, 1.0, 8, 8, clock=blind)
    first, second = zip(*rounds, strict=True)
    assert stats.speedup(first, second).estimate == 1.0


def test_every_round_times_every_contender_once_in_their_order() -> None:
    clock, log = FakeClock(), list[str]()
    contenders = [contender(clock, float(i + 1), log, str(i)) for i in range(3)]
    rounds = list(timing.rounds(contenders, budget_s=0.0, least=4, most=4, clock=clock))
    assert rounds == [[1.0, 2.0, 3.0]] * 4
    runs = [entry for entry in log if entry.startswith("run")]
    assert all(sorted(runs[i : i + 3]) == ["run 0", "run 1", "run 2"] for i in range(0, 12, 3))


def test_the_order_within_a_round_varies_and_follows_the_seed() -> None:
    def order(seed: int) -> list[str]:
        clock, log = FakeClock(), list[str]()
        contenders = [contender(clock, 1.0, log, str(i)) for i in range(4)]
        list(timing.rounds(contenders, 0.0, 10, 10, seed, clock))
        return [entry for entry in log if entry.startswith("run")]

    first = order(1)
    assert first == order(1) != order(2)
    assert len({tuple(first[i : i + 4]) for i in range(0, 40, 4)}) > 1


def test_it_stops_before_a_round_that_would_pass_the_budget() -> None:
    clock = FakeClock()
    contenders = [contender(clock, 50.0, [], "a")]  # a round takes 250
    assert len(list(timing.rounds(contenders, 1100.0, 1, 99, clock=clock))) == 4
    assert len(list(timing.rounds(contenders, 1100.0, 1, 99, clock=clock, longest_s=400.0))) == 3


def test_it_makes_at_least_and_at_most_the_rounds_asked_for() -> None:
    clock = FakeClock()
    contenders = [contender(clock, 1.0, [], "a")]
    assert len(list(timing.rounds(contenders, 0.0, 5, 99, clock=clock))) == 5
    assert len(list(timing.rounds(contenders, 1e9, 5, 8, clock=clock))) == 8


def test_the_orders_of_quads_are_both_drawn_and_follow_the_generator() -> None:
    orders = timing.draw_orders(50, random.Random(1))
    assert orders == timing.draw_orders(50, random.Random(1))
    assert orders != timing.draw_orders(50, random.Random(2))
    assert set(orders) == {"ABBA", "BAAB"}


def test_blocks_of_a_quad_run_in_the_order_drawn() -> None:
    clock, log = FakeClock(), list[str]()

    def spend(name: str, seconds: float) -> None:
        clock.now += seconds
        log.append(name)

    times = timing.block_times(
        lambda: spend("A", 2.0), lambda: spend("B", 3.0), ["ABBA", "BAAB"], clock
    )
    assert times == [[2.0, 3.0, 3.0, 2.0], [3.0, 2.0, 2.0, 3.0]]
    assert "".join(log) == "ABBABAAB"


def test_a_linear_drift_cancels_out_in_a_quad() -> None:
    clock, blocks = FakeClock(), list[float]()

    def drift() -> None:  # each block takes a second longer than the one before
        blocks.append(1.0 + len(blocks))
        clock.now += blocks[-1]

    orders = timing.draw_orders(10, random.Random(4))
    times = np.array(timing.block_times(drift, drift, orders, clock))
    baseline_s, candidate_s = stats.blocks_by_target(orders, times)
    np.testing.assert_array_equal(baseline_s.mean(axis=1), candidate_s.mean(axis=1))
