"""What Ctrl-C and other signals do while something is measured: the first interrupts, once.

It raises KeyboardInterrupt, so that processes are ended, files are removed, and what was measured
is saved. Further ones during the next seconds are ignored: they would interrupt just that.

Python drops an exception that leaves `__del__` or a callback of weakref, gc, ctypes or fork. Such a
KeyboardInterrupt is raised again until it reaches the command.
"""

import contextlib
import os
import signal
import stat
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from types import FrameType

from mjbench.status import ExitCode

# Seconds that the cleanup may take before a further signal is heeded.
CLEANUP_S = 10.0
# A closed terminal or a lost connection sends SIGHUP, which Windows does not have.
_NAMES = ("SIGINT", "SIGTERM", "SIGHUP")
# Seconds until a KeyboardInterrupt that was dropped is raised again.
_AGAIN_S = 0.001


def end_at_once() -> None:
    """From now on signals end the process with exit code 130: it has nothing to clean up yet."""
    _handle(lambda signum, frame: os._exit(ExitCode.INTERRUPTED))


def enable() -> None:
    """From now on signals end the command through its cleanup, or at once where that hangs."""
    has_alarm = hasattr(signal, "SIGALRM")
    interrupt = _Interrupt(time.monotonic, has_alarm, _leave_closed_terminal, _end_with_processes)
    if has_alarm:
        signal.signal(signal.SIGALRM, interrupt.raise_again)
    sys.unraisablehook = interrupt.note_dropped
    _handle(interrupt.handle)


def disable() -> None:
    """From now on the signals are ignored: the command has ended, the interpreter shuts down."""
    for name in (*_NAMES, "SIGALRM"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)


@contextlib.contextmanager
def one_interrupt(clock: Callable[[], float] = time.monotonic) -> Iterator[None]:
    """Let the first Ctrl-C interrupt the block of a program.

    A handler of the program's own stays in place. In another thread than the main one nothing
    changes: Ctrl-C does not reach it. What Python drops is not raised again, as SIGALRM is the
    program's, but the next Ctrl-C interrupts.
    """
    is_main = threading.current_thread() is threading.main_thread()
    if not is_main or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return
    interrupt, earlier_hook = _Interrupt(clock, has_alarm=False), sys.unraisablehook
    sys.unraisablehook = interrupt.note_dropped
    signal.signal(signal.SIGINT, interrupt.handle)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        sys.unraisablehook = earlier_hook


def _handle(handler: Callable[[int, FrameType | None], None]) -> None:
    """Set the handler of all signals that interrupt.

    What is ignored stays so: SIGHUP under `nohup`, SIGINT of a shell script's background command.
    """
    for name in _NAMES:
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, handler)


class _Interrupt:
    """Raises KeyboardInterrupt where a signal arrives, but not during the cleanup after it."""

    def __init__(
        self,
        clock: Callable[[], float],
        has_alarm: bool,
        on_first: Callable[[], None] = lambda: None,
        on_late: Callable[[], None] = lambda: None,
    ):
        """Take what is called at the first signal, and where the cleanup takes too long.

        Args:
          has_alarm: whether SIGALRM may be used, which calls `raise_again`.
        """
        self._clock, self._on_first, self._on_late = clock, on_first, on_late
        self._has_alarm, self._earlier_hook = has_alarm, sys.unraisablehook
        self._raised_s: float | None = None
        self._is_dropped = False

    def handle(self, signum: int, frame: FrameType | None) -> None:
        """Raise KeyboardInterrupt, unless the cleanup after an earlier one may be running."""
        if self._raised_s is None:
            self._on_first()
        elif not self._is_dropped:
            if self._clock() - self._raised_s <= CLEANUP_S:
                return
            self._on_late()
        self._raise()

    def note_dropped(self, unraisable: "sys.UnraisableHookArgs") -> None:
        """Take the place of `sys.unraisablehook`, which Python calls when it drops an exception."""
        is_interrupt = unraisable.exc_type is KeyboardInterrupt and self._raised_s is not None
        if not (is_interrupt and self._has_alarm):
            self._earlier_hook(unraisable)
        if is_interrupt:
            if self._has_alarm:
                signal.setitimer(signal.ITIMER_REAL, _AGAIN_S, _AGAIN_S)
            self._is_dropped = True  # last: Python would drop what is raised in this function, too

    def raise_again(self, signum: int, frame: FrameType | None) -> None:
        """Raise the KeyboardInterrupt that was dropped."""
        if self._is_dropped:
            self._raise()

    def _raise(self) -> None:
        self._raised_s, self._is_dropped = self._clock(), False
        if self._has_alarm:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
        raise KeyboardInterrupt


def _end_with_processes() -> None:
    from mjbench.host import child

    child.end_descendants()
    os._exit(ExitCode.INTERRUPTED)


def _leave_closed_terminal(descriptors: Sequence[int] = (1, 2)) -> None:
    """Let what is printed go nowhere where the terminal is closed: it would be an error."""
    for descriptor in descriptors:
        try:
            is_device = stat.S_ISCHR(os.fstat(descriptor).st_mode)
            if is_device and not os.isatty(descriptor):
                nowhere = os.open(os.devnull, os.O_WRONLY)
                os.dup2(nowhere, descriptor)
                os.close(nowhere)
        except OSError:
            continue
