"""Which values keyword arguments can have."""

from typing import Any

import numpy as np
import pytest

from mjbench.api import checks
from mjbench.errors import InputError
from mjbench.paired.outcomes import Metric


def test_values_in_range_are_returned() -> None:
    assert checks.seconds("t", 0.5) == 0.5
    assert checks.seconds("t", 0, zero=True) == 0.0
    assert checks.share("s", 0.01) == 0.01
    assert checks.count("n", np.int64(3)) == 3
    assert checks.seed("seed", 0) == 0
    assert checks.counts("n", 4) == [4]
    assert checks.counts("n", (1, 2, 1)) == [1, 2]
    assert checks.names("paths", "rollout, mjx") == ["rollout", "mjx"]
    assert checks.names("paths", ["a", "b,a"]) == ["a", "b"]
    assert checks.large_count("total_steps", 1e9, 10**15) == 10**9
    assert checks.choice("metric", "p99", Metric) is Metric.P99
    assert checks.optional(checks.count, "n", None, 5) is None
    assert checks.optional(checks.count, "n", 5, 5) == 5
    assert checks.rate_hz("rate_hz", 500, 1e6) == 500.0


@pytest.mark.parametrize(
    ("check", "value"),
    [
        (checks.seconds, 0),
        (checks.seconds, -1),
        (checks.seconds, float("nan")),
        (checks.seconds, float("inf")),
        (checks.seconds, "soon"),
        (checks.seconds, None),
        (checks.share, 0),
        (checks.share, 1),
        (checks.share, 5),
        (checks.count, 0),
        (checks.count, 1.5),
        (checks.count, True),
        (checks.count, 2**31),
        (checks.seed, -1),
        (checks.seed, 2**63),
        (checks.counts, []),
        (checks.counts, [0]),
        (checks.counts, "12"),
        (checks.names, []),
        (checks.names, ","),
        (checks.names, [3]),
        (lambda name, value: checks.optional(checks.count, name, value, 5), 6),
        (lambda name, value: checks.large_count(name, value, 100), 1e3),
        (lambda name, value: checks.large_count(name, value, 100), float("inf")),
        (lambda name, value: checks.choice(name, value, Metric), "tea"),
        (lambda name, value: checks.rate_hz(name, value, 10.0), 11),
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
