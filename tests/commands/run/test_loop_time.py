"""Shares of a loop are numbers, however short what was timed is."""

from dataclasses import replace

import pytest

from mjbench.commands.run import loop_time
from mjbench.commands.run.activities import Activity, Place
from mjbench.commands.run.call_times import CallTime
from mjbench.commands.run.loop_time import LoopTime, shares_of
from mjbench.commands.run.source_loops import SourceLoop

LOOP = SourceLoop("train.py", 10, 20)
# What a clock says of calls that are shorter than what it costs to time them.
UNSEEN = CallTime("mj_step", 1, 1, Place("train.py", 12, "main"), LOOP, 9, 0.0, 0, 0, 9, 9)
SAMPLED = LoopTime(
    LOOP, [], ["MainThread"], [1], True, 100, 2.0, {Activity.PYTHON: 1.0}, {"": 1.0}, [], [], 0.0
)


@pytest.mark.parametrize("total", [None, 0.0])
def test_of_nothing_no_part_has_a_share(total):
    assert shares_of([("a", 0.0), ("b", 0.0)], total) == {"a": 0.0, "b": 0.0}


@pytest.mark.parametrize(
    ("sampled", "rest"),
    [
        ([], Activity.REST),
        ([replace(SAMPLED, samples=3)], Activity.REST),
        ([SAMPLED], Activity.PYTHON),
    ],
    ids=["no samples", "few samples", "many samples"],
)
def test_calls_that_the_clock_did_not_see_leave_the_loop_to_the_rest(sampled, rest):
    (time,) = loop_time.with_calls(sampled, [UNSEEN], 1, {LOOP: None})
    assert time.activities == {Activity.PHYSICS: 0.0, rest: 1.0}
    assert time.seconds > 0
    collected = loop_time.with_collections(time, seconds=0.1)
    assert sum(collected.activities.values()) == pytest.approx(1.0)
