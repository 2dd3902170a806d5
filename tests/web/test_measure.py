"""How builds and C take turns, and how a build warms up; the clock is made up."""

import random
from collections.abc import Callable

import pytest

from mjbench.errors import Failure
from mjbench.status import Status
from mjbench.web import measure, timed_build
from mjbench.web.node_process import NodeError


class Clock:
    """Seconds that pass as blocks say, and nothing else."""

    def __init__(self) -> None:
        self.now_s = 0.0
        self.order: list[int] = []

    def __call__(self) -> float:
        return self.now_s

    def block(self, key: int, seconds: float) -> Callable[[], int]:
        def run() -> int:
            self.order.append(key)
            self.now_s += seconds
            return round(1e9 * seconds)

        return run


def never(key: int, error: NodeError) -> None:
    raise AssertionError(f"{key} failed: {error}")


def test_each_two_rounds_run_in_opposite_orders() -> None:
    clock = Clock()
    blocks = {key: clock.block(key, 0.01 * (key + 1)) for key in range(3)}
    rows = measure.rounds(blocks, 0.0, never, (), random.Random(0), clock)
    assert len(rows) == 8
    assert all(row == {0: 10_000_000, 1: 20_000_000, 2: 30_000_000} for row in rows)
    turns = [clock.order[i : i + 3] for i in range(0, len(clock.order), 3)]
    assert all(turns[i] == turns[i + 1][::-1] for i in range(0, 8, 2))
    assert len({tuple(turn) for turn in turns}) > 2


def test_rounds_end_with_the_budget() -> None:
    clock = Clock()
    rows = measure.rounds({0: clock.block(0, 0.1)}, 2.0, never, (), random.Random(0), clock)
    assert len(rows) == pytest.approx(20, abs=2)
    assert clock.now_s <= 2.0 + 1e-9


def test_a_block_that_fails_is_left_out_and_the_others_go_on() -> None:
    clock, failed = Clock(), []
    steady = clock.block(0, 0.01)
    count = iter(range(100))

    def fails() -> int:
        if next(count) == 5:
            raise NodeError("wasm", Failure(Status.CRASHED, "killed"))
        return 7

    rows = measure.rounds(
        {0: steady, 1: fails}, 0.0, lambda key, error: failed.append((key, str(error))),
        (), random.Random(0), clock,
    )  # fmt: skip
    assert failed == [(1, "wasm: killed")]
    assert [len(row) for row in rows] == [2] * 4 + [1] * 4
    assert all(0 in row for row in rows)


def test_a_block_that_takes_most_of_a_round_is_left_out_after_the_first() -> None:
    clock = Clock()
    blocks = {key: clock.block(key, seconds) for key, seconds in ((0, 0.01), (1, 0.01), (2, 1.0))}
    rows = measure.rounds(blocks, 10.0, never, (), random.Random(0), clock)
    assert sum(2 in row for row in rows) == 8
    assert all(2 in row for row in rows[:8])
    assert len(rows) == pytest.approx(100, abs=8)
    assert all({0, 1} <= set(row) for row in rows)
    assert all(2 in row for row in measure.rounds(blocks, 20.0, never, [2], clock=clock))


def test_a_block_may_fail_right_after_another_was_left_out() -> None:
    clock, failed = Clock(), []
    count = iter(range(100))

    def fails() -> int:
        if next(count) == 8:
            raise NodeError("wasm", Failure(Status.CRASHED, "killed"))
        return 7

    blocks = {0: clock.block(0, 0.01), 1: fails, 2: clock.block(2, 1.0)}
    rows = measure.rounds(
        blocks, 10.0, lambda key, error: failed.append(key), (), random.Random(0), clock
    )
    assert failed == [1]
    assert [len(row) for row in rows[:8]] == [3] * 8
    assert {len(row) for row in rows[8:]} == {1}


def warmed(block_ns: list[int], least_s: float) -> tuple[list[int], int]:
    """Return the blocks of warming up, of blocks that take so long, and how many were run."""
    clock, ran = Clock(), []

    def block() -> int:
        ns = block_ns[min(len(ran), len(block_ns) - 1)]
        ran.append(ns)
        clock.now_s += ns / 1e9
        return ns

    return timed_build.warm_up(block, least_s, clock), len(ran)


def test_warming_up_ends_when_blocks_get_no_faster() -> None:
    falling = [900_000_000 // (i + 1) for i in range(15)]
    blocks_ns, count = warmed([*falling, 1_000_000], 0.1)
    assert blocks_ns[0] == 900_000_000
    assert 25 <= count <= 35
    assert timed_build.seconds_before_steady(blocks_ns) == pytest.approx(sum(falling) / 1e9)


def test_steady_blocks_are_warm_at_once_but_run_for_the_least_time() -> None:
    blocks_ns, count = warmed([1_000_000], 0.1)
    assert blocks_ns[0] == 1_000_000
    assert timed_build.seconds_before_steady(blocks_ns) == 0.0
    assert count == pytest.approx(101, abs=1)


def test_blocks_that_never_get_steady_end_after_ten_seconds() -> None:
    faster_and_faster = [int(1e9 * 0.99**i) for i in range(1000)]
    assert sum(faster_and_faster[: warmed(faster_and_faster, 1.0)[1]]) == pytest.approx(
        10e9, rel=0.1
    )
