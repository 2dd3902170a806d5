"""What Ctrl-C, SIGTERM and a closed terminal do: a command ends through its cleanup, once.

The first of them raises KeyboardInterrupt, so that processes are ended, files are removed, and what
was measured is saved. Further ones during the next seconds are ignored: they would interrupt just
that. After those seconds one ends the command at once, with all of its processes.
"""

import os
import signal
import stat
import time
from collections.abc import Sequence
from types import FrameType

from mjbench.status import ExitCode

# Seconds that the cleanup may take before a further signal ends the command at once.
CLEANUP_S = 10.0
# A closed terminal or a lost connection sends SIGHUP, which Windows does not have.
_NAMES = ("SIGINT", "SIGTERM", "SIGHUP")


class _Interrupts:
    """The handler of the signals.

    Attributes:
      first_s: when the first signal came, in seconds; None before it.
    """

    def __init__(self) -> None:
        self.first_s: float | None = None

    def handle(self, signum: int, frame: FrameType | None) -> None:
        """Raise KeyboardInterrupt for the first signal; see the module for the others."""
        now = time.monotonic()
        if self.first_s is None:
            self.first_s = now
            _leave_closed_terminal()
            raise KeyboardInterrupt
        if now - self.first_s > CLEANUP_S:
            from mjbench.host import child

            child.end_descendants()
            os._exit(ExitCode.INTERRUPTED)


def enable() -> None:
    """From now on the signals end the command through its cleanup.

    What is ignored stays so: SIGHUP under `nohup`, SIGINT of a shell script's background command.
    """
    handler = _Interrupts()
    for name in _NAMES:
        number = getattr(signal, name, None)
        if number is None or signal.getsignal(number) == signal.SIG_IGN:
            continue
        signal.signal(number, handler.handle)


def disable() -> None:
    """From now on the signals are ignored: the command has ended, the interpreter shuts down."""
    for name in _NAMES:
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)


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
