"""Which variants are timed to the end."""

import random

from mjbench.comparison import measure


def rounds(*means: float, count: int = 8) -> list[dict[int, float]]:
    noise = random.Random(0)
    return [
        {i: mean * (1 + 0.01 * noise.random()) for i, mean in enumerate(means)}
        for _ in range(count)
    ]


def test_variants_that_cannot_be_the_fastest_are_left_out() -> None:
    assert measure.finalists(rounds(2.0, 1.0, 1.002, 1.5), [[0, 1, 2, 3]], []) == [1, 2]


def test_every_group_keeps_its_own_fastest() -> None:
    assert measure.finalists(rounds(2.0, 1.0, 1.5), [[0, 1, 2], [0, 2]], []) == [1, 2]


def test_the_base_stays_whatever_its_speed() -> None:
    assert measure.finalists(rounds(2.0, 1.0), [[0, 1], []], [0]) == [0, 1]


def test_too_few_rounds_leave_no_variant_out() -> None:
    assert measure.finalists(rounds(2.0, 1.0, count=3), [[0, 1]], []) == [0, 1]
