"""Run a function in a child process, so that a crash or a hang costs only its own rows.

The parent calls `run`, or `call` for a single answer; the child calls `child_main`. Arguments, and
the messages that the child sends back, are pickled; both sides are the same code. The child works
in an empty folder (MuJoCo writes log files into the current one), and it dies with the parent.
Messages have a connection of their own: all that the child writes to its output goes to a log.
"""

import contextlib
import json
import math
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from time import monotonic
from typing import Any, TypeVar, TypeVarTuple

from mjbench.errors import REFUSALS, MachineError, failure_of
from mjbench.host import child, child_connection, files, machine
from mjbench.host.child_connection import ChildConnection, ChildError
from mjbench.status import Status

_Answer = TypeVar("_Answer")
_Arguments = TypeVarTuple("_Arguments")
_ACTIVITY = "activity.json"
_LOG = "output.txt"
# The child's program; its arguments are the connection, and the parent.
_CHILD = "import sys; from mjbench.host.isolate import child_main; child_main(*sys.argv[1:])"


@dataclass(frozen=True)
class Ended:
    """How a child ended, in one line for people, and what the function returned.

    Attributes:
      position: of what the child worked on, among several, when it crashed, failed or hung; None
        where that is unknown.
    """

    status: Status
    detail: str = ""
    position: int | None = None
    answer: Any = None

    def check(self) -> None:
        """Raise what this end stands for: InputError, UnavailableError, or MachineError."""
        if self.status != Status.OK:
            raise REFUSALS.get(self.status, MachineError)(self.detail)


@dataclass(frozen=True)
class _SilenceAllowed:
    """From the child: its next message may take this long, whatever the parent's limit."""

    seconds: float


class Channel:
    """The child's side of the conversation."""

    def __init__(self, descriptor: int):
        self._connection = Connection(descriptor)
        self._pid = os.getpid()
        self._activity_file = Path.cwd() / _ACTIVITY  # the task may change the folder

    def receive(self) -> Any:
        return self._connection.recv()

    def send(self, message: object) -> None:
        """Send a message, a frozen dataclass, to the parent."""
        if os.getpid() != self._pid:  # a fork that the task did not end, and that runs on
            os._exit(1)
        self._connection.send(message)

    def allow_silence(self, seconds: float) -> None:
        """Extend the time limit until the next message to `seconds`; it is never shortened."""
        self.send(_SilenceAllowed(seconds))

    def doing(self, text: str, position: int | None = None) -> None:
        """Record what is done now, for the parent to read if this process dies: "killed while …".

        It goes to a file rather than to the parent, which would wake up beside a timed block. A
        full disk costs this record, not the work.
        """
        with contextlib.suppress(OSError):
            self._activity_file.write_text(json.dumps([text, position]), encoding="utf-8")


def run(
    function: Callable[[*_Arguments, Channel], object],
    arguments: tuple[*_Arguments],
    on_message: Callable[[Any], None],
    limit_s: float,
    import_from: str | None = None,
    environment: Mapping[str, str | None] | None = None,
    memory_bytes: int | None = None,
    end_s: float = math.inf,
) -> Ended:
    """Call a function of a module in a child.

    The child and all that it started are gone at the end, also when an exception (Ctrl-C) passes
    through.

    Args:
      arguments: before its last one, the channel; anything that pickles.
      limit_s: the child is killed after this long without a message.
      import_from: a further folder that the child may import from.
      environment: further environment variables of the child; None removes one.
      memory_bytes: the child is killed when it takes more.
      end_s: the child is killed at this time of the monotonic clock.
    """
    with files.temporary_folder() as folder:
        connection = child_connection.start(
            lambda descriptor: [sys.executable, "-c", _CHILD, str(descriptor), str(os.getpid())],
            folder / _LOG,
            limit_s,
            stdin=subprocess.DEVNULL,
            cwd=folder,
            env=_environment(import_from, environment or {}),
        )
        try:
            task = function, arguments
            end = _converse(connection, task, on_message, limit_s, memory_bytes, end_s)
        finally:
            connection.end()
        # what the child was doing says nothing more of an end that is the user's to mend
        return end if end.status in (Status.OK, *REFUSALS) else _located(end, folder)


def call(
    function: Callable[[*_Arguments, Channel], _Answer],
    *arguments: *_Arguments,
    limit_s: float,
    import_from: str | None = None,
    environment: Mapping[str, str | None] | None = None,
    memory_bytes: int | None = None,
    end_s: float = math.inf,
    otherwise: Callable[[Ended], _Answer] | None = None,
) -> _Answer:
    """Return what a function returns in a child (see `run`), or `otherwise` if it did not end well.

    Without `otherwise`, that raises as `Ended.check` does.
    """
    further = (import_from, environment, memory_bytes, end_s)
    ended = run(function, arguments, lambda message: None, limit_s, *further)
    if ended.status != Status.OK and otherwise is not None:
        return otherwise(ended)
    ended.check()
    answer: _Answer = ended.answer
    return answer


def _converse(
    connection: ChildConnection,
    to_call: object,
    on_message: Callable[[Any], None],
    limit_s: float,
    memory_bytes: int | None,
    end_s: float = math.inf,
) -> Ended:
    seconds = end_s - monotonic()

    def watch() -> None:
        if monotonic() > end_s:
            cause = f"killed after {max(0.0, seconds):.0f} s (its share of --budget)"
            raise connection.failure(Status.TIMEOUT, cause)
        if memory_bytes and child.memory_bytes(connection.process.pid) > memory_bytes:
            cause = f"took more than {memory_bytes / 2**30:.1f} GiB of memory, killed"
            raise connection.failure(Status.FAILED, cause)

    with contextlib.suppress(OSError):  # a dead child is reported when its answer is read
        connection.connection.send(to_call)
    limit, is_watched = limit_s, memory_bytes is not None or end_s < math.inf
    try:
        while True:
            content = connection.receive(limit, watch=watch if is_watched else None)
            message = connection.unpickled(content)
            if isinstance(message, Ended):
                return message
            if isinstance(message, _SilenceAllowed):
                limit = max(limit_s, message.seconds)
            else:
                limit = limit_s
                on_message(message)
    except ChildError as error:
        is_silent = error.ending == Status.TIMEOUT and monotonic() <= end_s
        hint = ", killed (--time-limit)" if is_silent else ""
        return Ended(error.ending, error.cause + hint)


def _located(end: Ended, folder: Path) -> Ended:
    try:
        text, position = json.loads(machine.read_text(folder / _ACTIVITY))
    except (ValueError, TypeError):  # none yet, or the child died while it wrote
        text, position = "", None
    detail = end.detail + (f" while {text}" if text else "")
    if end.status == Status.CRASHED:
        detail += child.last_line(folder / _LOG)
    return Ended(end.status, detail, position)


def _environment(import_from: str | None, others: Mapping[str, str | None]) -> dict[str, str]:
    root = str(Path(__file__).resolve().parents[2])
    parts = [root, os.environ.get("PYTHONPATH", ""), import_from or ""]
    path = os.pathsep.join(p for p in parts if p)
    variables = {**os.environ, **others, "PYTHONPATH": path}
    return {name: value for name, value in variables.items() if value is not None}


def child_main(descriptor: str, parent: str) -> None:
    """Be the child: call the function, and say how it ended."""
    child.die_with_parent(int(parent))
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.set_inheritable(int(descriptor), False)
    channel = Channel(int(descriptor))
    try:
        function, arguments = channel.receive()
        end = Ended(Status.OK, answer=function(*arguments, channel))
    except BaseException as error:  # a path of the user's own may raise SystemExit
        failure = failure_of(error)
        end = Ended(failure.status, failure.detail)
    try:
        channel.send(end)
    except OSError as error:
        print(failure_of(error).detail, file=sys.stderr, flush=True)  # noqa: T201  the log
        os._exit(1)
    os._exit(0)  # nothing here needs a tidy shutdown, and some engines hang in theirs
