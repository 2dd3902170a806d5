"""How many rounds a launch of a race has."""

from collections.abc import Sequence

import pytest

from mjbench.paired.race_launches import LONG_NS, LONG_ROUNDS, ROUNDS, time_rounds


@pytest.mark.parametrize(
    ("block_ns", "rounds"), [(1_000_000, ROUNDS), (LONG_NS // 6 + 1, LONG_ROUNDS)]
)
def test_long_blocks_have_fewer_rounds_in_both_orders(block_ns: int, rounds: int) -> None:
    orders: list[Sequence[int]] = []

    def time_round(order: Sequence[int]) -> list[int]:
        orders.append(order)
        return [block_ns] * 3

    assert time_rounds(time_round, 3) == [[block_ns] * 3] * rounds
    assert len(orders) == rounds
    assert orders[1] == orders[0][::-1]
