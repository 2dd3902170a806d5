"""How cells and figures in sentences are written."""

import math

import pytest

from mjbench import formats
from mjbench.interval import Interval, LogEstimate


@pytest.mark.parametrize(
    ("share", "text"), [(0.0123, "1.2 %"), (2e-9, "0.0000002 %"), (0.0, "0 %"), (1.234, "123 %")]
)
def test_a_share_has_two_significant_digits(share: float, text: str) -> None:
    assert formats.short_percent(share) == text


@pytest.mark.parametrize(
    ("ratio", "text"), [(1.1, "+10.0 %"), (0.9, "-10.0 %"), (2.0, "×2.00"), (0.4, "×0.40")]
)
def test_a_change_of_twice_is_a_factor(ratio: float, text: str) -> None:
    assert formats.log_change(math.log(ratio)) == text
    assert formats.change_with_error(LogEstimate(math.log(ratio), 0.01)).startswith(text[:5])


def test_an_estimate_has_its_standard_error() -> None:
    assert formats.change_with_error(LogEstimate(math.log(1.2), 0.01)) == "+20.0 ±1.2 %"
    assert formats.change_with_error(LogEstimate(math.log(3.0), 0.01)) == "×3.00 ±0.03"


def test_an_interval_has_its_unit_once() -> None:
    ratio = Interval(1.0, 0.98, 1.03)
    assert formats.ends(ratio) == "0.98–1.03"
    assert formats.ends_in(formats.change)(ratio) == "-2.00 to +3.00 %"
    assert formats.in_brackets(ratio, formats.change) == " (-2.00 to +3.00 %)"


def test_an_interval_without_an_end_is_not_written() -> None:
    assert formats.ends(Interval(1.0, None, 1.03)) == formats.ends(None) == ""
    assert formats.in_brackets(Interval(1.0, 0.9, None)) == ""
