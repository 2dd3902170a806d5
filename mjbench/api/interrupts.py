"""What Ctrl-C and other signals do while something is measured: the first interrupts, once.

It raises KeyboardInterrupt, so that processes are ended, files are removed, and what was measured
is saved. Further ones during the next seconds are ignored: they would interrupt just that.
"""

import contextlib
import os
import signal
import stat
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from types import FrameType

from mjbench.measuring.calls import nothing
from mjbench.status import ExitCode

# Seconds that the cleanup may take before a further signal is heeded.
CLEANUP_S = 10.0
# A closed terminal or a lost connection sends SIGHUP, which Windows does not have.
_NAMES = ("SIGINT", "SIGTERM", "SIGHUP")

_Handler = Callable[[int, FrameType | None], None]


def enable() -> None:
    """From now on signals end the command through its cleanup, or at once where that hangs.

    What is ignored stays so: SIGHUP under `nohup`, SIGINT of a shell script's background command.
    """
    handler = _handler(time.monotonic, _leave_closed_terminal, _end_at_once)
    for name in _NAMES:
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, handler)


def disable() -> None:
    """From now on the signals are ignored: the command has ended, the interpreter shuts down."""
    for name in _NAMES:
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)


@contextlib.contextmanager
def one_interrupt(clock: Callable[[], float] = time.monotonic) -> Iterator[None]:
    """Let the first Ctrl-C interrupt the block of a program.

    A handler of the program's own stays in place. In another thread than the main one nothing
    changes: Ctrl-C does not reach it.
    """
    is_main = threading.current_thread() is threading.main_thread()
    if not is_main or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return
    signal.signal(signal.SIGINT, _handler(clock))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def _handler(
    clock: Callable[[], float],
    on_first: Callable[[], None] = nothing,
    on_late: Callable[[], None] = nothing,
) -> _Handler:
    """Return a handler that raises KeyboardInterrupt, but not during the cleanup after it."""
    last_s: float | None = None

    def handle(signum: int, frame: FrameType | None) -> None:
        nonlocal last_s
        now_s = clock()
        if last_s is not None and now_s - last_s <= CLEANUP_S:
            return
        is_first, last_s = last_s is None, now_s
        (on_first if is_first else on_late)()
        raise KeyboardInterrupt

    return handle


def _end_at_once() -> None:
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
