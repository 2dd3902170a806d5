import random

import pytest

from mjbench.comparison import measure
from mjbench.comparison.sizes import BlockSizes, SizeRequest, choose_sizes
from mjbench.simulation import work


def rounds(*means: float, count: int = 8) -> list[dict[int, float]]:
    noise = random.Random(0)
    return [
        {i: mean * (1 + 0.01 * noise.random()) for i, mean in enumerate(means)}
        for _ in range(count)
    ]


def test_variants_that_cannot_be_the_fastest_are_left_out() -> None:
    seen = rounds(2.0, 1.0, 1.002, 1.5)
    assert measure.finalists(seen, [[0, 1, 2, 3]], []) == [1, 2]


def test_every_group_keeps_its_own_fastest() -> None:
    assert measure.finalists(rounds(2.0, 1.0, 1.5), [[0, 1, 2], [0, 2]], []) == [1, 2]


def test_the_base_stays_whatever_its_speed() -> None:
    assert measure.finalists(rounds(2.0, 1.0), [[0, 1], []], [0]) == [0, 1]


def test_too_few_rounds_leave_nobody_out() -> None:
    assert measure.finalists(rounds(2.0, 1.0, count=3), [[0, 1]], []) == [0, 1]


@pytest.mark.parametrize(("has_accelerated", "nstep"), [(False, 1), (True, 10)])
def test_a_large_batch_has_few_steps_but_not_one_where_paths_compile(
    has_accelerated: bool, nstep: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(work, "step_s", lambda model: 1e-5)
    request = SizeRequest(nbatch=65536, nthread=2, has_accelerated=has_accelerated)
    assert choose_sizes(None, request) == BlockSizes(65536, nstep, reduced=True)
