"""What Ctrl-C does in a notebook or a script: a measurement ends through its cleanup, once."""

import contextlib
import signal
import threading
import time
from collections.abc import Callable, Iterator
from types import FrameType

# Seconds that the cleanup may take before a further Ctrl-C interrupts it.
CLEANUP_S = 10.0


@contextlib.contextmanager
def once(clock: Callable[[], float] = time.monotonic) -> Iterator[None]:
    """Let the first Ctrl-C interrupt the block; further ones do not disturb its cleanup.

    A handler of the program's own stays in place. In another thread than the main one nothing
    changes: Ctrl-C does not reach it.

    Args:
      clock: returns seconds.
    """
    is_main = threading.current_thread() is threading.main_thread()
    if not is_main or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return
    first_s: float | None = None

    def handle(signum: int, frame: FrameType | None) -> None:
        nonlocal first_s
        now = clock()
        if first_s is not None and now - first_s <= CLEANUP_S:
            return
        first_s = now
        raise KeyboardInterrupt

    signal.signal(signal.SIGINT, handle)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
