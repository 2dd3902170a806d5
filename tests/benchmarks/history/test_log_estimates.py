"""Log ratios as changes, with their standard errors."""

import math

import pytest

from benchmarks.history.log_estimates import LogEstimate, change_with_error, log_change


@pytest.mark.parametrize(
    ("ratio", "text"), [(1.1, "+10.0 %"), (0.9, "-10.0 %"), (2.0, "×2.00"), (0.4, "×0.40")]
)
def test_a_change_of_twice_is_a_factor(ratio: float, text: str) -> None:
    assert log_change(math.log(ratio)) == text
    assert change_with_error(LogEstimate(math.log(ratio), 0.01)).startswith(text[:5])


def test_an_estimate_has_its_standard_error() -> None:
    assert change_with_error(None) == ""
    assert change_with_error(LogEstimate(math.log(1.2), 0.01)) == "+20.0 ±1.2 %"
    assert change_with_error(LogEstimate(math.log(3.0), 0.01)) == "×3.00 ±0.03"
