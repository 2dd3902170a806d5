"""Odd programs behave under `mjbench run` as they do under Python alone."""

from collections.abc import Sequence
from dataclasses import replace

import pytest

from benchmarks import same_behaviour
from benchmarks.odd_programs import ODD_PROGRAMS, OddProgram
from benchmarks.same_behaviour import Behaviour

# What some programs of `odd_programs` do, in as few processes as can do it one after the other:
# each program runs twice. `python -m benchmarks.same_behaviour` runs all of them, alone.
QUICK = (
    ("syntax error",),
    ("callback", "rollout", "fault handler"),
    ("closes all files", "SIGTERM that is handled"),
)


@pytest.mark.parametrize("names", QUICK, ids=", ".join)
def test_a_program_behaves_as_under_python_alone(names: Sequence[str]) -> None:
    *others, last = (ODD_PROGRAMS[name] for name in names)
    text = "\n".join(str(each.text) for each in (*others, last))
    assert others == [OddProgram(each.text) for each in others]
    assert list(same_behaviour.differences(replace(last, text=text))) == []


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
