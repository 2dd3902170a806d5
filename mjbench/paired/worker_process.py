"""A process in the environment of one release, seen from its parent."""

import contextlib
import pickle
import shutil
from collections import deque
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Protocol, TypeVar

from mjbench.errors import Failure, InputError, MachineError, UnavailableError, one_line
from mjbench.instrument import child, machine
from mjbench.paired import requests
from mjbench.paired.requests import Request
from mjbench.status import Status

_T = TypeVar("_T")
# A worker that has closed its connection has ended, or does within this many seconds.
_EXIT_S = 5.0
# A failure is no longer than this.
_MAX_FAILURE_BYTES = 1 << 16


class TargetError(MachineError):
    """A target's process crashed, hung or failed; the message names the target in one line.

    Attributes:
      ending: whether it crashed, hung (`timeout`) or failed.
      cause: the message without the target and what it was doing.
    """

    def __init__(self, message: str, ending: Status = Status.FAILED, cause: str = ""):
        super().__init__(message)
        self.ending, self.cause = ending, cause or message


class Process(Protocol):
    """What a worker runs in; see `child.ChildProcess`."""

    @property
    def pid(self) -> int:
        """Its process id."""

    def wait(self, timeout_s: float | None = None) -> int | None:
        """Return its exit code, or None if it goes on for longer than this."""

    def end(self) -> object:
        """Kill it with everything that it started."""


class WorkerProcess:
    """A worker, seen from its parent: it answers requests in the order they were sent.

    Attributes:
      connection: to the worker.
      name: for error messages, such as `baseline (MuJoCo 4.0.0, cartpole)`.
      limit_s: seconds without an answer after which the process is killed.
    """

    def __init__(
        self,
        connection: Connection,
        name: str,
        limit_s: float,
        process: Process,
        output_file: Path,
        moved_install: Path | None = None,
    ):
        self.connection, self.name, self.limit_s = connection, name, limit_s
        self._process, self._output_file = process, output_file
        self._moved_install = moved_install
        self._pending: deque[Request[Any]] = deque()

    @property
    def pid(self) -> int:
        """The process id."""
        return self._process.pid

    def call(self, request: Request[_T]) -> _T:
        """Send a request and return its answer; no other request may be pending.

        Raises:
          InputError: what was asked for cannot be.
          TargetError: the process failed, crashed or did not answer in time.
        """
        self.ask(request)
        answer: _T = self._answer()
        return answer

    def ask(self, request: Request[Any]) -> None:
        """Send a small request, without waiting for its answer."""
        self._pending.append(request)
        with contextlib.suppress(OSError):  # a dead worker is reported when its answer is read
            self.connection.send(request)

    def wait(self) -> None:
        """Wait for the answers to all pending requests.

        Raises:
          InputError: what was asked for cannot be.
          TargetError: the process failed, crashed or did not answer in time.
        """
        while self._pending:
            self._answer()

    def is_ready(self) -> bool:
        """Return whether all requests are answered, without waiting for one.

        Raises:
          InputError: what was asked for cannot be.
          TargetError: the process failed or crashed.
        """
        while self._pending and self.connection.poll():
            self._answer()
        return not self._pending

    def time_block(self) -> int:
        """Have one block run, after `TimeBlocks` was asked; return its nanoseconds.

        Raises:
          TargetError: the process failed, crashed or did not answer in time.
        """
        with contextlib.suppress(OSError):
            self.connection.send_bytes(requests.BLOCK)
        content = self._receive(requests.NANOSECONDS.size + _MAX_FAILURE_BYTES)
        if len(content) != requests.NANOSECONDS.size:  # the block failed, and ended `TimeBlocks`
            raise TargetError(f"{self.name}: {self._unpickled(content, Failure).detail}")
        ns = int(requests.NANOSECONDS.unpack(content)[0])
        if ns <= 0:
            raise TargetError(f"{self.name}: reports that a block took {ns} ns")
        return ns

    def end_blocks(self) -> None:
        """End `TimeBlocks`."""
        with contextlib.suppress(OSError):
            self.connection.send_bytes(requests.END)
        self._answer()

    def end(self) -> None:
        """End the process, whatever it is doing."""
        self.connection.close()
        self._process.end()
        self._output_file.unlink(missing_ok=True)
        if self._moved_install is not None:
            shutil.rmtree(self._moved_install, ignore_errors=True)

    def _answer(self) -> Any:
        """Return the answer to the oldest pending request."""
        content = self._receive(machine.available_memory_bytes())
        answer: requests.Done[Any] | Failure = self._unpickled(content, requests.Done, Failure)
        self._pending.popleft()
        if isinstance(answer, requests.Done):
            return answer.value
        message = f"{self.name}: {answer.detail}"
        kinds = {Status.INPUT: InputError, Status.UNAVAILABLE: UnavailableError}
        if kind := kinds.get(answer.status):
            raise kind(message)
        raise TargetError(message, cause=answer.detail)

    def _receive(self, max_bytes: int) -> bytes:
        """Return the bytes of the next answer, `max_bytes` at most."""
        activity = self._pending[0].activity
        if not self.connection.poll(self.limit_s):
            self._process.end()
            output = child.last_line(self._output_file)
            cause = f"no answer within {self.limit_s:g} s"
            message = f"{self.name}: {cause} while {activity}{output}"
            raise TargetError(message, Status.TIMEOUT, cause)
        try:
            return self.connection.recv_bytes(max_bytes)
        except (EOFError, OSError):
            cause = self._describe_end()
            output = child.last_line(self._output_file)
            message = f"{self.name}: {cause} while {activity}{output}"
            raise TargetError(message, Status.CRASHED, cause) from None

    def _describe_end(self) -> str:
        """Describe how the process ended; one that goes on sent an answer that is too long."""
        code = self._process.wait(_EXIT_S)
        if code is not None:
            return child.describe_exit(code)
        self._process.end()
        return "sent an invalid answer, killed"

    def _unpickled(self, content: bytes, *kinds: type) -> Any:
        """Return the answer that bytes stand for.

        Raises:
          TargetError: they stand for nothing of these kinds.
        """
        try:
            answer = pickle.loads(content)
        except Exception as error:  # damaged bytes raise whatever they spell
            answer = error
        if not isinstance(answer, kinds):
            self._process.end()
            activity = self._pending[0].activity
            raise TargetError(
                f"{self.name}: sent an invalid answer, killed while {activity}"
                f" ({one_line(repr(content[:20]))})"
            )
        return answer
