"""What signals do while something is measured: the first interrupts, further ones wait."""

import gc
import os
import pty
import signal
import sys
import threading
import weakref
from collections.abc import Callable, Iterator
from types import SimpleNamespace

import pytest
from commands import python

from mjbench.api import interrupts
from mjbench.host import child


class ExitedError(Exception):
    """Stands for the end of the process."""


@pytest.fixture(autouse=True)
def restored_handlers() -> Iterator[None]:
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGALRM)
    before = {number: signal.getsignal(number) for number in numbers}
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


def from_finalizer(ctrl_c: Callable[[], None]) -> None:
    class Finalized:
        def __del__(self) -> None:
            ctrl_c()

    Finalized()


def from_weakref(ctrl_c: Callable[[], None]) -> None:
    class Referenced:
        pass

    value = Referenced()
    reference = weakref.ref(value, lambda _: ctrl_c())
    del value
    assert reference() is None


def from_collection(ctrl_c: Callable[[], None]) -> None:
    def once(*arguments: object) -> None:
        gc.callbacks.remove(once)
        ctrl_c()

    gc.callbacks.append(once)
    gc.collect()


DROPPING = [from_finalizer, from_weakref, from_collection]


@pytest.mark.parametrize("drop", DROPPING)
def test_a_ctrl_c_that_python_drops_interrupts_what_comes_next(
    drop: Callable[[Callable[[], None]], None],
) -> None:
    interrupts.enable()
    with pytest.raises(KeyboardInterrupt):
        drop(lambda: signal.raise_signal(signal.SIGINT))
        threading.Event().wait(60.0)  # only where it fails


def test_it_is_raised_until_it_is_not_dropped(monkeypatch: pytest.MonkeyPatch) -> None:
    timers: list[tuple[float, ...]] = []
    monkeypatch.setattr(signal, "setitimer", lambda which, *seconds: timers.append(seconds))
    interrupts.enable()
    from_finalizer(lambda: signal.raise_signal(signal.SIGINT))
    from_weakref(lambda: signal.raise_signal(signal.SIGALRM))
    from_collection(lambda: signal.raise_signal(signal.SIGALRM))
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGALRM)
    signal.raise_signal(signal.SIGALRM)
    assert [seconds[0] > 0.0 for seconds in timers] == [False, True] * 3 + [False]


def test_the_seconds_of_the_cleanup_begin_when_it_is_not_dropped(
    clock: SimpleNamespace, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(signal, "setitimer", lambda *arguments: None)
    interrupts.enable()
    from_finalizer(lambda: signal.raise_signal(signal.SIGINT))
    clock.now += interrupts.CLEANUP_S
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)
    clock.now += interrupts.CLEANUP_S
    signal.raise_signal(signal.SIGINT)


def test_a_ctrl_c_is_not_lost_in_a_hook_of_fork() -> None:
    program = (
        "import os, subprocess, threading\n"
        "from mjbench.api import interrupts\n"
        "interrupts.enable()\n"
        "os.register_at_fork(after_in_parent=lambda: os.kill(os.getpid(), 2))\n"
        "for _ in range(3): subprocess.run(['true'], preexec_fn=int)\n"
        "threading.Event().wait(60.0)\n"
        "print('goes on after 3 Ctrl-C')"
    )
    done = python("-c", program)
    assert (done.returncode, done.stdout) == (-signal.SIGINT, "")
    assert "Exception ignored" not in done.stderr


def test_other_exceptions_that_python_drops_are_printed_as_ever(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def fail() -> None:
        raise ValueError

    dropped: list[type[BaseException]] = []
    monkeypatch.setattr(sys, "unraisablehook", lambda args: dropped.append(args.exc_type))
    interrupts.enable()
    from_finalizer(fail)
    assert dropped == [ValueError]
    signal.raise_signal(signal.SIGALRM)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_imports_that_are_interrupted_end_with_130_and_print_nothing(
    number: signal.Signals,
) -> None:
    program = (
        "import os, sys\n"
        "from mjbench.__main__ import main\n"
        "class Sender:\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        f"        if name == 'mjbench.cli': os.kill(os.getpid(), {number.value})\n"
        "sys.meta_path.insert(0, Sender())\n"
        "main()"
    )
    done = python("-c", program, "--help")
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "")


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
def test_the_second_interrupts_where_python_drops_the_first(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    dropped: list[type[BaseException]] = []

    def note(arguments: "sys.UnraisableHookArgs") -> None:
        dropped.append(arguments.exc_type)

    monkeypatch.setattr(sys, "unraisablehook", note)
    with interrupts.one_interrupt(lambda: 100.0):
        from_finalizer(lambda: signal.raise_signal(signal.SIGINT))
        assert dropped == [KeyboardInterrupt]
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
    assert sys.unraisablehook is note


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
