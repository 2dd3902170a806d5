"""The connection to a child process: what it sends within a time limit, or how it ended instead.

Messages are framed as `multiprocessing.connection` does it: four bytes hold the length of what
follows, the highest first. All children that answer over a connection fail in the same words.
"""

import contextlib
import os
import pickle
import socket
import struct
import sys
from collections.abc import Callable, Sequence
from multiprocessing.connection import Connection, wait
from pathlib import Path
from time import monotonic
from typing import Any, Protocol

from mjbench.errors import MachineError, one_line, writing
from mjbench.host import child
from mjbench.status import Status

# No message is nearly as long.
MAX_MESSAGE_BYTES = 1 << 26
# A child that has closed its connection has ended, or does within this many seconds.
_EXIT_S = 5.0
# How often a child is watched, in seconds; the longest wait, whose milliseconds are an `int` of C.
_WATCH_S, _LONGEST_WAIT_S = 0.2, 1e6


class Process(Protocol):
    """What a child runs in; see `child.ChildProcess`."""

    @property
    def pid(self) -> int:
        """Its process id."""

    def wait(self, timeout_s: float | None = None) -> int | None:
        """Return its exit code, or None if it goes on for longer than this."""

    def end(self) -> object:
        """Kill it with everything that it started."""


class ChildError(MachineError):
    """A child crashed, hung, failed or sent garbage; the message names it, if it has a name.

    Attributes:
      cause: how, without its name, what it was doing and what it printed.
    """

    def __init__(self, ending: Status, cause: str, circumstances: str = "", name: str = ""):
        super().__init__(f"{name}: {cause}{circumstances}" if name else cause + circumstances)
        self.ending, self.cause = ending, cause


class ChildConnection:
    """This process's end of the connection to a child."""

    def __init__(self, connection: Connection, process: Process, output_file: Path, name: str = ""):
        """Take over our end of a `pair`; error messages begin with the child's name, if any."""
        self.connection, self.process, self._name = connection, process, name
        self._output_file = output_file
        # what is ready when the child has sent something or ended; of a child that is still being
        # forked, the end is known later
        self._awaited: list[Connection] = []

    def receive(
        self,
        limit_s: float,
        activity: str = "",
        max_bytes: int = MAX_MESSAGE_BYTES,
        watch: Callable[[], None] | None = None,
    ) -> bytes:
        """Return the next message; the child is killed where none begins within `limit_s`.

        Args:
          activity: what it is doing, such as `stepping the model`.
          watch: called every now and then; what it raises is passed on.
        """
        if not self._poll(limit_s, watch):
            raise self._timeout(f"no answer within {limit_s:g} s", activity)
        try:
            return self.connection.recv_bytes(max_bytes)
        except BlockingIOError:
            raise self._timeout("sent part of an answer, then nothing", activity) from None
        except (EOFError, ConnectionResetError):
            cause = "closed its connection, killed"
        except OSError:  # what it sent is no message, or is too long
            cause = "sent an invalid answer, killed"
        code = self.process.wait(_EXIT_S)
        if code is not None:
            cause = child.describe_exit(code)
        raise self.failure(Status.CRASHED, cause, activity)

    def unpickled(self, content: bytes, activity: str = "", *kinds: type) -> Any:
        """Return what a message stands for; raise ChildError where it is of none of these kinds."""
        try:
            message = pickle.loads(content)
        except Exception as error:  # damaged bytes raise whatever they spell
            raise self.invalid(content, activity) from error
        if not isinstance(message, kinds or object):
            raise self.invalid(content, activity)
        return message

    def invalid(self, content: bytes, activity: str = "") -> ChildError:
        """Kill the child; return the error that it sent something else than a message."""
        sent = one_line(repr(content[:20]))
        return self.failure(Status.CRASHED, f"sent an invalid answer ({sent}), killed", activity)

    def failure(self, ending: Status, cause: str, activity: str = "") -> ChildError:
        """Kill the child; return the error that says so, and what the child last printed."""
        self.process.end()
        doing = f" while {activity}" if activity else ""
        return ChildError(ending, cause, doing + child.last_line(self._output_file), self._name)

    def end(self) -> None:
        try:
            self.process.end()
        finally:
            for each in {self.connection, *self._awaited}:
                each.close()

    def _timeout(self, cause: str, activity: str) -> ChildError:
        """Kill a silent child; return the error that says so, or how it ended if it had."""
        code = self.process.wait(0.0)
        if code is None:
            return self.failure(Status.TIMEOUT, cause, activity)
        return self.failure(Status.CRASHED, child.describe_exit(code), activity)

    def _poll(self, limit_s: float, watch: Callable[[], None] | None) -> bool:
        """Wait until there is something to read; return whether there is.

        A child that has ended may have left a process that keeps its end of the connection open.
        Where the system can, nothing wakes up here beside a child that is timed.
        """
        self._awaited = self._awaited or [self.connection, *_exit_handles(self.process)]
        wakes = watch is not None or self._awaited == [self.connection]
        deadline_s = monotonic() + limit_s
        while (left_s := deadline_s - monotonic()) > 0.0:
            if watch is not None:
                watch()
            ready = wait(self._awaited, min(left_s, _WATCH_S if wakes else _LONGEST_WAIT_S))
            if self.connection in ready:
                return True
            if ready or self.process.wait(0.0) is not None:
                break
        return self.connection.poll()


def _exit_handles(process: Process) -> list[Connection]:
    """Return what is ready when a process ends, for `wait`: nothing is read from it."""
    if sys.platform == "linux" and process.wait(0.0) is None:  # its id is still its own
        with contextlib.suppress(OSError):
            return [Connection(os.pidfd_open(process.pid), writable=False)]
    return []


def start(
    command: Callable[[int], Sequence[str]], output_file: Path, limit_s: float, **arguments: Any
) -> ChildConnection:
    ours, theirs = pair(limit_s)
    try:
        with theirs, writing(output_file), output_file.open("wb") as output:
            process = child.Child(
                command(theirs.fileno()),
                stdout=output,
                stderr=output,
                pass_fds=[theirs.fileno()],
                **arguments,
            )
    except BaseException:
        ours.close()
        raise
    return ChildConnection(ours, process, output_file)


def pair(limit_s: float) -> tuple[Connection, socket.socket]:
    """Return both ends of a connection with this longest silence within a message, ours first."""
    ours, theirs = sockets(socket.SOCK_STREAM)
    ours.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, timeval(limit_s))
    return Connection(ours.detach()), theirs


def sockets(kind: int) -> tuple[socket.socket, socket.socket]:
    try:
        return socket.socketpair(type=kind)
    except OSError as error:
        raise MachineError(f"cannot start a process: {one_line(error)}") from error


def timeval(seconds: float) -> bytes:
    """Return a time as the `struct timeval` of C."""
    whole = int(seconds)
    return struct.pack("@ll", whole, int(1e6 * (seconds - whole)))
