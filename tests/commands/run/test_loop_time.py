"""Shares of a loop are numbers, however short what was timed is."""

import pytest

from mjbench.commands.run.loop_time import shares_of


@pytest.mark.parametrize("total", [None, 0.0])
def test_of_nothing_no_part_has_a_share(total):
    assert shares_of([("a", 0.0), ("b", 0.0)], total) == {"a": 0.0, "b": 0.0}
