"""Draws that take all items equally often."""

import random
from collections import Counter

import pytest

from mjbench.paired.balanced_draws import BalancedDraws


@pytest.mark.parametrize(("size", "count"), [(8, 1), (16, 2), (7, 3), (5, 5), (1, 1)])
def test_all_are_drawn_equally_often_and_none_twice_at_once(size: int, count: int) -> None:
    draws = BalancedDraws(size, random.Random(3))
    counts: Counter[int] = Counter()
    for _ in range(40):
        drawn = draws.draw(count)
        assert len(set(drawn)) == count
        assert set(drawn) <= set(range(size))
        counts.update(drawn)
        assert max(counts.values()) - min(counts[i] for i in range(size)) <= 1
    if size % count == 0 and 40 * count % size == 0:
        assert set(counts.values()) == {40 * count // size}


def test_the_order_is_random() -> None:
    orders = {tuple(BalancedDraws(8, random.Random(seed)).draw(8)) for seed in range(20)}
    assert len(orders) == 20
