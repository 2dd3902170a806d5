"""What disturbs a measurement is noticed, and said in one sentence."""

import itertools

import pytest

from mjbench.host import disturbance, machine, neighbours
from mjbench.host.disturbance import Disturbance, Watch
from mjbench.host.machine import CoreChange, ProcessorTime
from mjbench.host.neighbours import Neighbour


def test_all_that_disturbed_is_one_sentence() -> None:
    seen = Disturbance(["ab", "compare"], 0.134, CoreChange(2, 1))
    assert disturbance.sentence(seen.clauses) == (
        "Disturbed: the host took 13 % of the processor time for others; mjbench ab, mjbench"
        " compare measured on this machine at the same time; the usable cores changed from 2 to 1."
        " Measure again."
    )


def test_a_small_share_of_the_host_is_no_disturbance() -> None:
    assert Disturbance(stolen_share=0.019).clauses == []
    assert disturbance.sentence([]) == ""


def test_what_was_seen_once_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    seen = itertools.chain([[Neighbour(1, "tune"), Neighbour(2, "tune")]], itertools.repeat([]))
    monkeypatch.setattr(neighbours, "measuring_now", lambda: next(seen))
    allowed = itertools.chain([2.0, 1.0], itertools.repeat(2.0))
    monkeypatch.setattr(machine, "allowed_cores", lambda: next(allowed))
    monkeypatch.setattr(machine, "usable_cores", lambda: 2)
    monkeypatch.setattr(ProcessorTime, "stolen_since", lambda now, begin: 0.01)
    watch = Watch([Neighbour(3, "env")])
    expected = Disturbance(["env", "tune"], 0.01, CoreChange(2, 1))
    assert [watch.look(), watch.look()] == [expected, expected]
