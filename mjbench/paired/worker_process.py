"""A process in the environment of one release, seen from its parent."""

import contextlib
import shutil
from collections import deque
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Concatenate, ParamSpec, TypeVar

from mjbench.errors import REFUSALS, Failure
from mjbench.host import machine
from mjbench.host.child_connection import ChildConnection, ChildError, Process
from mjbench.paired import worker_answers
from mjbench.paired.worker import Worker
from mjbench.paired.worker_answers import Done
from mjbench.status import Status

_P = ParamSpec("_P")
_T = TypeVar("_T")
# What a worker can be asked: a method of `Worker`, or a function of one, which runs there.
Task = Callable[Concatenate[Worker, _P], _T]
# A failure is no longer than this.
_MAX_FAILURE_BYTES = 1 << 16


class WorkerProcess:
    """A worker, seen from its parent: it does tasks in the order they were asked for."""

    def __init__(
        self,
        connection: Connection,
        name: str,
        limit_s: float,
        process: Process,
        output_file: Path,
        moved_install: Path | None = None,
    ):
        self.name, self.limit_s = name, limit_s
        self._child = ChildConnection(connection, process, output_file, name)
        self._output_file, self._moved_install = output_file, moved_install
        # What the process is doing, and what it will do next.
        self._activities: deque[str] = deque()

    @property
    def pid(self) -> int:
        return self._child.process.pid

    def call(self, task: Task[_P, _T], *args: _P.args, **kwargs: _P.kwargs) -> _T:
        """Have a task done and return its answer; no other task may be pending.

        Raises:
          InputError: what was asked for cannot be.
          ChildError: the process failed, crashed or did not answer in time.
        """
        self.ask(task, *args, **kwargs)
        answer: _T = self._answer()
        return answer

    def ask(self, task: Task[_P, Any], *args: _P.args, **kwargs: _P.kwargs) -> None:
        """Ask for a task with small arguments, without waiting for its answer."""
        self._activities.append(task.__dict__["activity"])
        with contextlib.suppress(OSError):  # a dead worker is reported when its answer is read
            self._child.connection.send((task, args, kwargs))

    def wait(self) -> None:
        """Wait for the answers to all pending tasks; raise what `call` does."""
        while self._activities:
            self._answer()

    def is_ready(self) -> bool:
        """Return whether all tasks are done, without waiting for one; raise what `call` does."""
        while self._activities and self._child.connection.poll():
            self._answer()
        return not self._activities

    def time_block(self) -> int:
        """Have one block run, after `Worker.time_blocks` was asked; return its nanoseconds."""
        with contextlib.suppress(OSError):
            self._child.connection.send_bytes(worker_answers.BLOCK)
        activity, size = self._activities[0], worker_answers.NANOSECONDS.size
        content = self._child.receive(self.limit_s, activity, size + _MAX_FAILURE_BYTES)
        if len(content) != size:  # the block failed, and ended the task
            raise self._failed(self._child.unpickled(content, activity, Failure).detail)
        ns = int(worker_answers.NANOSECONDS.unpack(content)[0])
        if ns <= 0:
            raise self._failed(f"reports that a block took {ns} ns")
        return ns

    def end_blocks(self) -> None:
        with contextlib.suppress(OSError):
            self._child.connection.send_bytes(worker_answers.END)
        self._answer()

    def end(self) -> None:
        self._child.end()
        self._output_file.unlink(missing_ok=True)
        if self._moved_install is not None:
            shutil.rmtree(self._moved_install, ignore_errors=True)

    def _answer(self) -> Any:
        activity = self._activities[0]
        content = self._child.receive(self.limit_s, activity, machine.available_memory_bytes())
        answer: Done[Any] | Failure = self._child.unpickled(content, activity, Done, Failure)
        self._activities.popleft()
        if isinstance(answer, Done):
            return answer.value
        if kind := REFUSALS.get(answer.status):
            raise kind(f"{self.name}: {answer.detail}")
        raise self._failed(answer.detail)

    def _failed(self, cause: str) -> ChildError:
        return ChildError(Status.FAILED, cause, name=self.name)
