"""Garbage collections are counted and timed, and no signal is lost in them."""

import pytest
from still_clock import StillClock

from mjbench.commands.run.hook import collection_clock


@pytest.fixture
def fake():
    return StillClock(1_000)


@pytest.fixture
def clock(fake):
    return collection_clock.CollectionClock(fake)


def collect(clock, fake, ns):
    clock.callback("start", {"generation": 0})
    fake.now += ns
    clock.callback("stop", {"generation": 0})


def test_collections_are_counted_with_their_time_and_the_longest(clock, fake):
    written = []
    clock.begin(lambda *totals: written.append(totals))
    for ns in (20, 50, 30):
        collect(clock, fake, ns)
    assert written == [(0, 0, 0), (1, 20, 20), (2, 70, 50), (3, 100, 50)]


def test_what_was_before_the_beginning_and_after_the_end_does_not_count(clock, fake):
    written = []
    collect(clock, fake, 20)
    for ns in (50, 30):
        clock.begin(lambda *totals: written.append(totals))
        collect(clock, fake, ns)
    clock.end()
    collect(clock, fake, 20)
    assert written == [(0, 0, 0), (1, 50, 50), (0, 0, 0), (1, 30, 30)]


def test_a_collection_that_began_before_the_clock_counts_from_then(clock, fake):
    written = []
    clock.begin(lambda *totals: written.append(totals))
    fake.now += 10
    clock.callback("stop", {})
    assert written[-1] == (1, 10, 10)
