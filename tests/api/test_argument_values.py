"""Which values keyword arguments can have."""

from typing import Any

import numpy as np
import pytest

from mjbench.api import argument_values
from mjbench.errors import InputError
from mjbench.limits import HERTZ, LARGE_COUNT, SECONDS, SECONDS_OR_ZERO, SEED, SHARE, Bounds
from mjbench.paired.metrics import Metric


def test_values_in_range_are_returned() -> None:
    assert argument_values.number("t", 0.5, SECONDS) == 0.5
    assert argument_values.number("t", 0, SECONDS_OR_ZERO) == 0.0
    assert argument_values.number("s", 0.01, SHARE) == 0.01
    assert argument_values.whole("n", np.int64(3)) == 3
    assert argument_values.whole("seed", 0, SEED) == 0
    assert argument_values.wholes("n", 4) == [4]
    assert argument_values.wholes("n", (1, 2, 1)) == [1, 2]
    assert argument_values.names("paths", "rollout, mjx") == ["rollout", "mjx"]
    assert argument_values.names("paths", ["a", "b,a"]) == ["a", "b"]
    assert argument_values.whole("total_steps", 1e9, LARGE_COUNT, is_float=True) == 10**9
    assert argument_values.choice("metric", "load", Metric) is Metric.LOAD
    assert argument_values.optional(argument_values.whole, "n", None, Bounds(1, 5)) is None
    assert argument_values.optional(argument_values.whole, "n", 5, Bounds(1, 5)) == 5
    assert argument_values.number("rate_hz", 500, HERTZ) == 500.0


def seconds(name: str, value: Any) -> float:
    return argument_values.number(name, value, SECONDS)


def share(name: str, value: Any) -> float:
    return argument_values.number(name, value, SHARE)


@pytest.mark.parametrize(
    ("check", "value"),
    [
        *((seconds, value) for value in (0, -1, float("nan"), float("inf"), "soon", None)),
        *((share, value) for value in (0, 1, 5)),
        *((argument_values.whole, value) for value in (0, 1.5, True, 2**31)),
        (lambda name, value: argument_values.whole(name, value, SEED), -1),
        (lambda name, value: argument_values.whole(name, value, SEED), 2**63),
        *((argument_values.wholes, value) for value in ([], [0], "12")),
        (argument_values.names, []),
        (argument_values.names, ","),
        (argument_values.names, [3]),
        (
            lambda name, value: argument_values.optional(
                argument_values.whole, name, value, Bounds(1, 5)
            ),
            6,
        ),
        (lambda name, value: argument_values.whole(name, value, LARGE_COUNT, is_float=True), 1e16),
        (
            lambda name, value: argument_values.whole(name, value, LARGE_COUNT, is_float=True),
            float("inf"),
        ),
        (lambda name, value: argument_values.choice(name, value, Metric), "tea"),
        (lambda name, value: argument_values.number(name, value, HERTZ), 1e7),
    ],
)
def test_other_values_are_refused_in_a_line_that_names_the_argument(check: Any, value: Any) -> None:
    with pytest.raises(InputError, match=r"^size ") as error:
        check("size", value)
    assert "\n" not in str(error.value)


def test_steps_are_whole_holds() -> None:
    argument_values.holds(None, 7)
    argument_values.holds(10, 5)
    with pytest.raises(InputError, match="not a multiple of hold 3"):
        argument_values.holds(10, 3)
