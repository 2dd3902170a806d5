"""What `isolate` runs in a child, run in this process: for tests of what it does, not of its end.

A child takes half a second to start. Requests, messages and answers are pickled here, too; that a
crash, a hang or an exit ends the child alone is tested where children are started.
"""

import contextlib
import math
import pickle
import sys
import tempfile
from collections.abc import Callable, Mapping
from typing import Any
from unittest import mock

from mjbench.errors import failure_of
from mjbench.host import isolate
from mjbench.host.isolate import Ended
from mjbench.status import Status

_run_in_child = isolate.run


class InlineChannel:
    """The child's side of a conversation; its messages arrive as they are sent."""

    def __init__(self, on_message: Callable[[Any], None]):
        self._on_message = on_message

    def send(self, message: object) -> None:
        self._on_message(pickle.loads(pickle.dumps(message)))

    def allow_silence(self, seconds: float) -> None:
        pass

    def doing(self, text: str, position: int | None = None) -> None:
        pass


def run(
    function: Callable[..., object],
    arguments: tuple[object, ...],
    on_message: Callable[[Any], None],
    limit_s: float,
    import_from: str | None = None,
    environment: Mapping[str, str | None] | None = None,
    memory_bytes: int | None = None,
    end_s: float = math.inf,
) -> Ended:
    """Stand in for `isolate.run`; a task with variables that a child reads as it starts has one."""
    if environment:
        return _run_in_child(
            function, arguments, on_message, limit_s, import_from, environment, memory_bytes, end_s
        )
    call, own = pickle.loads(pickle.dumps((function, arguments)))
    path = [*sys.path, *([import_from] if import_from else [])]
    with (
        tempfile.TemporaryDirectory() as folder,
        mock.patch.object(sys, "path", path),
        contextlib.chdir(folder),
    ):
        try:
            answer = call(*own, InlineChannel(on_message))
        except BaseException as error:
            failure = failure_of(error)
            return Ended(failure.status, failure.detail)
    return Ended(Status.OK, answer=pickle.loads(pickle.dumps(answer)))
