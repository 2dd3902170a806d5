"""Which values keyword arguments can have."""

from typing import Any

import numpy as np
import pytest

from mjbench.api import checks
from mjbench.errors import InputError
from mjbench.limits import HERTZ, LARGE_COUNT, SECONDS, SECONDS_OR_ZERO, SEED, SHARE, Bounds
from mjbench.paired.metrics import Metric


def test_values_in_range_are_returned() -> None:
    assert checks.number("t", 0.5, SECONDS) == 0.5
    assert checks.number("t", 0, SECONDS_OR_ZERO) == 0.0
    assert checks.number("s", 0.01, SHARE) == 0.01
    assert checks.whole("n", np.int64(3)) == 3
    assert checks.whole("seed", 0, SEED) == 0
    assert checks.wholes("n", 4) == [4]
    assert checks.wholes("n", (1, 2, 1)) == [1, 2]
    assert checks.names("paths", "rollout, mjx") == ["rollout", "mjx"]
    assert checks.names("paths", ["a", "b,a"]) == ["a", "b"]
    assert checks.whole("total_steps", 1e9, LARGE_COUNT, is_float=True) == 10**9
    assert checks.choice("metric", "p99", Metric) is Metric.P99
    assert checks.optional(checks.whole, "n", None, Bounds(1, 5)) is None
    assert checks.optional(checks.whole, "n", 5, Bounds(1, 5)) == 5
    assert checks.number("rate_hz", 500, HERTZ) == 500.0


def seconds(name: str, value: Any) -> float:
    return checks.number(name, value, SECONDS)


def share(name: str, value: Any) -> float:
    return checks.number(name, value, SHARE)


@pytest.mark.parametrize(
    ("check", "value"),
    [
        *((seconds, value) for value in (0, -1, float("nan"), float("inf"), "soon", None)),
        *((share, value) for value in (0, 1, 5)),
        *((checks.whole, value) for value in (0, 1.5, True, 2**31)),
        (lambda name, value: checks.whole(name, value, SEED), -1),
        (lambda name, value: checks.whole(name, value, SEED), 2**63),
        *((checks.wholes, value) for value in ([], [0], "12")),
        (checks.names, []),
        (checks.names, ","),
        (checks.names, [3]),
        (lambda name, value: checks.optional(checks.whole, name, value, Bounds(1, 5)), 6),
        (lambda name, value: checks.whole(name, value, LARGE_COUNT, is_float=True), 1e16),
        (lambda name, value: checks.whole(name, value, LARGE_COUNT, is_float=True), float("inf")),
        (lambda name, value: checks.choice(name, value, Metric), "tea"),
        (lambda name, value: checks.number(name, value, HERTZ), 1e7),
    ],
)
def test_other_values_are_refused_in_a_line_that_names_the_argument(check: Any, value: Any) -> None:
    with pytest.raises(InputError, match=r"^size ") as error:
        check("size", value)
    assert "\n" not in str(error.value)


def test_steps_are_whole_holds() -> None:
    checks.holds(None, 7)
    checks.holds(10, 5)
    with pytest.raises(InputError, match="not a multiple of hold 3"):
        checks.holds(10, 3)
