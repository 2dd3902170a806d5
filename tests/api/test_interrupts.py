"""What signals do while something is measured: the first interrupts, further ones wait."""

import os
import pty
import signal
import threading
from collections.abc import Iterator
from types import SimpleNamespace

import pytest

from mjbench.api import interrupts
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


@pytest.fixture
def usual_handler() -> Iterator[None]:
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


# in a program


@pytest.mark.usefixtures("usual_handler")
def test_the_first_interrupts_and_the_second_does_not() -> None:
    now = [100.0]
    with interrupts.one_interrupt(lambda: now[0]):
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        now[0] += interrupts.CLEANUP_S
        signal.raise_signal(signal.SIGINT)
        now[0] += 1.0
        with pytest.raises(KeyboardInterrupt):  # the cleanup hangs
            signal.raise_signal(signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.usefixtures("usual_handler")
def test_a_handler_of_the_programs_own_stays() -> None:
    def own(*arguments: object) -> None:
        pass

    signal.signal(signal.SIGINT, own)
    with interrupts.one_interrupt():
        assert signal.getsignal(signal.SIGINT) is own
    assert signal.getsignal(signal.SIGINT) is own


@pytest.mark.usefixtures("usual_handler")
def test_another_thread_leaves_the_handler_alone() -> None:
    seen: list[object] = []

    def work() -> None:
        with interrupts.one_interrupt():
            seen.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert seen == [signal.default_int_handler]
