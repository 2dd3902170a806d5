"""Other mjbench that measure are found by their command lines; one that waits lets others begin."""

from dataclasses import dataclass
from typing import Any

import pytest

from mjbench.host import neighbours
from mjbench.host.neighbours import Neighbour

ME = 20


@dataclass
class Process:
    """What is read of a process."""

    pid: int
    words: list[str] | None
    began_s: float | None = 0.0

    @property
    def info(self) -> dict[str, Any]:
        return {"cmdline": self.words, "create_time": self.began_s}

    def cmdline(self) -> list[str]:
        return self.words or []

    def create_time(self) -> float:
        return self.began_s or 0.0


def others(*processes: Any, me: Process | None = None) -> list[Neighbour]:
    me = me or Process(ME, ["mjbench", "tune"], 10.0)
    return neighbours.select([me, *processes], me)  # type: ignore[arg-type, list-item]


@pytest.mark.parametrize(
    "words",
    [
        ["/usr/bin/python3.12", "/home/me/.venv/bin/mjbench", "compare", "robot.xml"],
        ["python", "-m", "mjbench", "compare"],
        ["/Library/Python.app/Contents/MacOS/Python", "-P", "-m", "mjbench", "compare"],
        ["mjbench", "compare"],
    ],
)
def test_an_mjbench_that_measures_is_found(words: list[str]) -> None:
    assert others(Process(7, words)) == [Neighbour(7, "compare")]


@pytest.mark.parametrize(
    "words",
    [
        None,
        [],
        [""],
        ["mjbench"],
        ["mjbench", "--help"],
        ["mjbench", "lint", "train.py"],
        ["mjbench", "sweep", "plan.toml"],
        ["vim", "mjbench", "compare"],
        ["python", "train.py", "mjbench", "compare"],
        ["python", "-c", "import mjbench", "compare"],
        ["python"],
    ],
)
def test_what_measures_nothing_is_not(words: list[str] | None) -> None:
    assert others(Process(7, words)) == []


def test_a_check_up_is_named_by_its_target_in_one_short_line() -> None:
    (other,) = others(Process(7, ["mjbench", f"a\n{'x' * 100}.xml"]))
    assert len(other.command) <= 40 and "\n" not in other.command


def test_this_process_is_no_other() -> None:
    assert others() == []


def test_of_two_that_wait_the_earlier_begins() -> None:
    early = Process(7, ["mjbench", "compare", "--wait"], 1.0)
    late = Process(8, ["mjbench", "ab", "--wait"], 2.0)
    assert others(late, me=early) == []
    assert others(early, me=late) == [Neighbour(7, "compare")]


def test_two_that_began_at_once_do_not_wait_for_each_other() -> None:
    two = [Process(pid, ["mjbench", "compare", "--wait"]) for pid in (7, 8)]
    assert others(two[1], me=two[0]) == []
    assert others(two[0], me=two[1]) == [Neighbour(7, "compare")]


def test_nobody_waits_for_a_program_that_imports_mjbench_so_it_does() -> None:
    program = Process(ME, ["python", "train.py"], 1.0)
    late = Process(8, ["mjbench", "ab", "--wait"], 2.0)
    assert others(late, me=program) == [Neighbour(8, "ab")]


def test_the_processes_of_this_machine_can_be_read(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(neighbours.IGNORE_VARIABLE)
    monkeypatch.setattr(neighbours, "mjbench_words", lambda words: list(words[:1]))
    assert neighbours.measuring_now()
    monkeypatch.setenv(neighbours.IGNORE_VARIABLE, "1")
    assert neighbours.measuring_now() == []


def test_one_that_waits_looks_until_the_others_have_ended() -> None:
    events: list[object] = []
    seen = iter([[Neighbour(7, "compare")], [Neighbour(7, "compare")], []])
    neighbours.wait_for_others(events.append, lambda: next(seen), events.append)
    assert events == [[Neighbour(7, "compare")], 1.0, 1.0]


def test_one_that_is_alone_waits_for_nobody() -> None:
    calls: list[object] = []
    neighbours.wait_for_others(calls.append, list, calls.append)
    assert calls == []
