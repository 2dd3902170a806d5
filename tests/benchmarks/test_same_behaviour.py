"""Odd programs behave under `mjbench run` as they do under Python alone."""

import pytest

from benchmarks import same_behaviour
from benchmarks.odd_programs import ODD_PROGRAMS
from benchmarks.same_behaviour import Behaviour

# `python -m benchmarks.same_behaviour` runs them all.
QUICK = (
    "syntax error",
    "closes all files",
    "fault handler",
    "SIGTERM that is handled",
    "callback",
    "rollout",
)


@pytest.mark.parametrize("name", QUICK)
def test_a_program_behaves_as_under_python_alone(name: str) -> None:
    assert list(same_behaviour.differences(ODD_PROGRAMS[name])) == []


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
