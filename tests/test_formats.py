"""How cells and figures in sentences are written."""

import pytest

from mjbench import formats
from mjbench.interval import Interval


@pytest.mark.parametrize(
    ("share", "text"), [(0.0123, "1.2 %"), (2e-9, "0.0000002 %"), (0.0, "0 %"), (1.234, "123 %")]
)
def test_a_share_has_two_significant_digits(share: float, text: str) -> None:
    assert formats.short_percent(share) == text


def test_an_interval_has_its_unit_once() -> None:
    ratio = Interval(1.0, 0.98, 1.03)
    assert formats.ends(ratio) == "0.98–1.03"
    assert formats.ends_in(formats.change)(ratio) == "-2.00 to +3.00 %"
    assert formats.in_brackets(ratio, formats.change) == " (-2.00 to +3.00 %)"


def test_an_interval_without_an_end_is_not_written() -> None:
    assert formats.ends(Interval(1.0, None, 1.03)) == formats.ends(None) == ""
    assert formats.in_brackets(Interval(1.0, 0.9, None)) == ""
