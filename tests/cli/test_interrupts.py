"""What signals do to a command: the first ends it through its cleanup, further ones wait."""

import os
import pty
import signal
from collections.abc import Iterator
from types import SimpleNamespace

import pytest

from mjbench.cli import interrupts
from mjbench.host import child


class ExitedError(Exception):
    """Stands for the end of the process."""


@pytest.fixture(autouse=True)
def restored_handlers() -> Iterator[None]:
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    before[signal.SIGHUP] = signal.getsignal(signal.SIGHUP)
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    clock = SimpleNamespace(now=100.0)
    clock.monotonic = lambda: clock.now
    monkeypatch.setattr(interrupts, "time", clock)
    return clock


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_ctrl_c_termination_and_a_closed_terminal_interrupt_alike(number: signal.Signals) -> None:
    interrupts.enable()
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(number)


def test_a_second_ctrl_c_does_not_interrupt_the_cleanup(clock: SimpleNamespace) -> None:
    interrupts.enable()
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)
    clock.now += interrupts.CLEANUP_S
    signal.raise_signal(signal.SIGINT)
    signal.raise_signal(signal.SIGHUP)


def test_a_cleanup_that_hangs_is_ended_with_all_processes(
    clock: SimpleNamespace, monkeypatch: pytest.MonkeyPatch
) -> None:
    done: list[str] = []

    def leave(code: int) -> None:
        done.append(f"exit {code}")
        raise ExitedError

    monkeypatch.setattr(child, "end_descendants", lambda: done.append("ended processes"))
    monkeypatch.setattr(os, "_exit", leave)
    interrupts.enable()
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)
    clock.now += interrupts.CLEANUP_S + 1
    with pytest.raises(ExitedError):
        signal.raise_signal(signal.SIGINT)
    assert done == ["ended processes", "exit 130"]


def test_nohup_keeps_a_command_running_when_the_terminal_closes() -> None:
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    interrupts.enable()
    signal.raise_signal(signal.SIGHUP)
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGTERM)


def test_a_command_that_has_ended_is_not_interrupted() -> None:
    interrupts.enable()
    interrupts.disable()
    signal.raise_signal(signal.SIGINT)


def test_printing_to_a_closed_terminal_goes_nowhere() -> None:
    ours, terminal = pty.openpty()
    interrupts._leave_closed_terminal([terminal])
    assert os.isatty(terminal)
    os.close(ours)  # the other end hangs up
    interrupts._leave_closed_terminal([terminal])
    os.write(terminal, b"nobody reads this")
    os.close(terminal)
