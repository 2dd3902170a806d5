"""Tracebacks that the user sees hold no frames of the clocks."""

import os
import sys
from typing import Any

_HERE = os.path.dirname(os.path.abspath(__file__))


def hide_clocks() -> None:
    """Let what an uncaught exception prints leave out the clock's own frames."""
    earlier = sys.excepthook

    def report(kind: type[BaseException], error: BaseException, frames: Any) -> None:
        earlier(kind, error, _without_own(frames))

    sys.excepthook = report
    import threading

    earlier_of_threads = threading.excepthook

    def report_of_thread(arguments: Any) -> None:
        error = arguments.exc_value
        if error is not None:
            error = error.with_traceback(_without_own(error.__traceback__))
            arguments = threading.ExceptHookArgs(
                (arguments.exc_type, error, error.__traceback__, arguments.thread)
            )
        earlier_of_threads(arguments)

    threading.excepthook = report_of_thread


def _without_own(frames: Any) -> Any:
    """Return a traceback without the frames of the clocks."""
    rest = []
    while frames is not None:
        if not frames.tb_frame.f_code.co_filename.startswith(_HERE):
            rest.append(frames)
        frames = frames.tb_next
    following = None
    for frame in reversed(rest):
        frame.tb_next = following
        following = frame
    return following
