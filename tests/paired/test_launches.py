"""The loop of launches: what it asks of a rule, and how it ends. Nothing is launched."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import pytest

from mjbench.errors import Failure, InputError, MachineError
from mjbench.paired.launches import StopRule, Targets, UnableError, launch
from mjbench.paired.time_limit import OutOfTimeError
from mjbench.status import Status


@dataclass
class Letters(Targets[str]):
    """Launches give the letters at the positions; one may raise instead.

    Attributes:
      errors: by the number of the launch; that of 0 is raised before the first.
      at_end: raised where what is left is to end.
    """

    errors: dict[int, BaseException] = field(default_factory=dict)
    asked: list[Sequence[int]] = field(default_factory=list)
    at_end: BaseException | None = None
    is_closed: bool = False

    def prepare(self) -> None:
        self._fail()

    def launch(self, positions: Sequence[int]) -> str:
        self.asked.append(positions)
        self._fail()
        return "".join("abc"[position] for position in positions)

    def close(self) -> None:
        self.is_closed = True
        if self.at_end is not None:
            raise self.at_end

    def _fail(self) -> None:
        if error := self.errors.get(len(self.asked)):
            raise error


@dataclass
class Four(StopRule[str]):
    """All that can go on, until there are four launches; the first target is needed."""

    able: list[int] = field(default_factory=lambda: [0, 1, 2])
    launches: list[str] = field(default_factory=list)

    def next_targets(self) -> Sequence[int]:
        return list(self.able) if len(self.launches) < 4 else []

    def add(self, launch: str) -> None:
        self.launches.append(launch)

    def withdraw(self, error: UnableError) -> None:
        if error.position == 0:
            super().withdraw(error)
        self.able.remove(error.position)


def test_a_rule_says_what_is_launched_and_when_it_ends() -> None:
    letters, rule = Letters(), Four()
    known: list[int] = []
    ending = launch(letters, rule, lambda: known.append(len(rule.launches)))
    assert ending == Failure(Status.OK, "")
    assert known == [1, 2, 3, 4]
    assert rule.launches == ["abc"] * 4
    assert letters.is_closed


def test_a_target_that_cannot_go_on_is_withdrawn() -> None:
    letters, rule = Letters({2: UnableError(1, Status.CRASHED, "killed")}), Four()
    assert launch(letters, rule) == Failure(Status.OK, "")
    assert rule.launches == ["abc", "ac", "ac", "ac"]


@pytest.mark.parametrize(
    ("error", "ending"),
    [
        (UnableError(0, Status.CRASHED, "killed"), Failure(Status.CRASHED, "killed")),
        (MachineError("it fell over"), Failure(Status.FAILED, "it fell over")),
        (InputError("no such thing"), Failure(Status.INPUT, "no such thing")),
        (OutOfTimeError("give more"), Failure(Status.OK, "give more")),
        (KeyboardInterrupt(), Failure(Status.INTERRUPTED, "interrupted")),
    ],
    ids=["needed target", "machine", "input", "time", "Ctrl-C"],
)
@pytest.mark.parametrize("number", [0, 3])
def test_what_was_launched_before_the_end_stays(
    error: BaseException, ending: Failure, number: int
) -> None:
    letters, rule = Letters({number: error}), Four()
    assert launch(letters, rule) == ending
    assert len(rule.launches) == max(0, number - 1)
    assert letters.is_closed


@pytest.mark.parametrize("error", [KeyboardInterrupt(), BrokenPipeError()], ids=["Ctrl-C", "pipe"])
def test_what_is_left_ends_where_showing_a_launch_is_cut_short(error: BaseException) -> None:
    letters, rule = Letters(), Four()

    def show() -> None:
        raise error

    if isinstance(error, KeyboardInterrupt):
        assert launch(letters, rule, show).status == Status.INTERRUPTED
    else:
        with pytest.raises(BrokenPipeError):
            launch(letters, rule, show)
    assert rule.launches == ["abc"]
    assert letters.is_closed


@pytest.mark.parametrize(
    ("error", "at_end", "status"),
    [
        (None, MachineError("it does not end"), Status.FAILED),
        (KeyboardInterrupt(), MachineError("it does not end"), Status.INTERRUPTED),
        (MachineError("it fell over"), KeyboardInterrupt(), Status.INTERRUPTED),
        (InputError("no such thing"), MachineError("it does not end"), Status.INPUT),
    ],
)
def test_processes_that_do_not_end_hide_neither_an_interrupt_nor_a_failure(
    error: BaseException | None, at_end: BaseException, status: Status
) -> None:
    errors = {2: error} if error else {}
    assert launch(Letters(errors, at_end=at_end), Four()).status == status


@pytest.mark.parametrize("at_end", [None, MachineError("it does not end"), KeyboardInterrupt()])
def test_a_fault_of_the_program_is_no_ending(at_end: BaseException | None) -> None:
    letters = Letters({2: ZeroDivisionError()}, at_end=at_end)
    with pytest.raises(ZeroDivisionError):
        launch(letters, Four())
    assert letters.is_closed
