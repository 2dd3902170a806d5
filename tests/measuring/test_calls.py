"""How many calls last as long as a block; clocks are invented."""

import itertools
from collections.abc import Iterator

import pytest

from mjbench.measuring import calls


@pytest.mark.parametrize(("call_s", "block_s"), [(1e-6, calls.BLOCK_S), (1.0, 1.0)])
def test_fast_functions_are_called_many_times_in_a_block(call_s: float, block_s: float) -> None:
    count = calls.calls_per_block(lambda count: count * call_s)
    assert count * call_s == pytest.approx(block_s, rel=0.1)


def test_a_pause_is_not_taken_for_a_long_call() -> None:
    pauses: Iterator[float] = itertools.chain([0.0, 0.004], itertools.repeat(0.0))
    count = calls.calls_per_block(lambda count: count * 1e-6 + next(pauses))
    assert count * 1e-6 == pytest.approx(calls.BLOCK_S, rel=0.1)


def test_a_function_that_takes_no_time_does_not_hang() -> None:
    assert calls.calls_per_block(lambda count: 0.0) == calls.MOST_CALLS


def test_a_function_is_called_as_often_as_asked() -> None:
    called = itertools.count()
    calls.repeat(lambda: next(called), 5)
    assert next(called) == 5
