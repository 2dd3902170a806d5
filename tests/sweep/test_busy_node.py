"""A node refuses where others use it, and says so; what it sees is measured with its own clock."""

from dataclasses import replace

import pytest

from mjbench.host import machine
from mjbench.host.machine import ProcessorTime
from mjbench.host.neighbours import Neighbour
from mjbench.sweep import busy_node
from mjbench.sweep.busy_node import Limits, NodeState

QUIET = NodeState(cores=8, usable_cores=8, cores_had=7.9, busy_cores=0.2, stolen=0.0)


def test_a_quiet_node_measures() -> None:
    assert busy_node.objection(QUIET, Limits()) == ""


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"cores_had": 5.0}, "threads get 5.00 of 8 usable cores"),
        ({"busy_cores": 2.5}, "others keep 2.5 of 8 cores busy, of which 8 are usable"),
        ({"stolen": 0.2}, "its host takes 20 % of its processor time for others"),
        (
            {"neighbours": (Neighbour(7, "compare"),)},
            "mjbench compare, process 7 measures there",
        ),
    ],
)
def test_a_node_that_is_not_quiet_says_why(change: dict[str, object], reason: str) -> None:
    assert busy_node.objection(replace(QUIET, **change), Limits()) == reason  # type: ignore[arg-type]


def test_cores_that_this_process_may_not_use_can_be_busy() -> None:
    beside = replace(QUIET, usable_cores=2, cores_had=2.0, busy_cores=6.0)
    assert busy_node.objection(beside, Limits()) == ""


def test_a_plan_can_ask_for_less() -> None:
    loud = NodeState(cores=2, usable_cores=2, cores_had=0.5, busy_cores=2.01, stolen=0.9)
    anything = Limits(min_cores=0.0, max_busy=1.0, max_stolen=1.0)
    assert busy_node.objection(loud, anything) == ""


def test_it_sees_what_others_use_while_it_sleeps(monkeypatch: pytest.MonkeyPatch) -> None:
    time = {"now": 0.0, "busy": 0.0}

    def sleep(seconds: float) -> None:
        time["now"] += seconds
        time["busy"] += 1.5 * seconds  # others use one core and a half

    def clock() -> float:
        time["now"] += 0.01
        return time["now"]

    monkeypatch.setattr(machine, "usable_cores", lambda: 2)
    now = staticmethod(lambda: ProcessorTime(time["busy"], 0.0))
    monkeypatch.setattr(busy_node.ProcessorTime, "now", now)
    state = busy_node.calibrate(sleep, clock)
    assert state.busy_cores == pytest.approx(1.5, rel=0.05)
    assert state.cores_had == pytest.approx(2.0)  # both pieces of work take one tick of the clock
    assert (state.usable_cores, state.stolen) == (2, 0.0)
