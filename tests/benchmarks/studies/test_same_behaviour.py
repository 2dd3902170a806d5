"""Odd programs behave under `mjbench run` as they do under Python alone."""

from dataclasses import replace

import pytest

from benchmarks.studies import same_behaviour
from benchmarks.studies.odd_programs import ODD_PROGRAMS
from benchmarks.studies.same_behaviour import Behaviour

# `python -m benchmarks.studies.same_behaviour` runs them all, each alone. Here, some run in turn in
# one process; what closes all files is alone, because nothing is recorded afterwards.
QUICK = (
    ["syntax error"],
    ["fault handler", "callback", "rollout", "SIGTERM that is handled"],
    ["closes all files"],
)


@pytest.mark.parametrize("names", QUICK, ids=" and ".join)
def test_programs_behave_as_under_python_alone(names: list[str]) -> None:
    programs = [ODD_PROGRAMS[name] for name in names]
    in_turn = replace(programs[-1], text="\n".join(str(each.text) for each in programs))
    assert list(same_behaviour.differences(in_turn)) == []


def test_a_difference_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    first, second = Behaviour(0, "1\n", "", {}), Behaviour(3, "2\n", "", {"a.txt": b""})
    monkeypatch.setattr(same_behaviour, "plain", lambda *_: first)
    monkeypatch.setattr(same_behaviour, "observed", lambda *_: second)
    seen = list(same_behaviour.differences(ODD_PROGRAMS["fork"]))
    assert seen[0] == "exit code 0, and 3 under mjbench run"
    assert {"-1", "+2"} <= set(seen)
    assert seen[-1] == "a.txt: None, and b''"


def test_there_are_more_than_thirty_programs() -> None:
    assert len(ODD_PROGRAMS) > 30
