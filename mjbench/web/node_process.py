"""A Node process that steps a WebAssembly build, seen from its parent.

It answers requests one by one (see `messages`), in an empty folder. It dies with its parent. One
that does not answer within its time limit is killed.
"""

import contextlib
import dataclasses
import json
import os
import selectors
import subprocess
import sys
import time
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from mjbench.errors import Failure, MachineError, one_line, writing
from mjbench.instrument import child
from mjbench.paired import cores
from mjbench.status import Status
from mjbench.web import messages
from mjbench.web.messages import Request
from mjbench.web.node import Node

_T = TypeVar("_T")
_RUNNER = Path(__file__).with_name("runner.mjs")
# No answer is longer.
_MAX_ANSWER_BYTES = 1 << 26
# A process that has closed its pipe has ended, or does within this many seconds.
_EXIT_S = 5.0


class NodeError(MachineError):
    """A Node process failed, crashed or hung; the message names it in one line.

    Attributes:
      failure: how, without that name.
    """

    def __init__(self, name: str, failure: Failure):
        super().__init__(f"{name}: {failure.detail}")
        self.status = failure.status
        self.failure = failure


class NodeProcess:
    """A process of Node that runs our program.

    Attributes:
      name: for error messages, such as `wasm (cartpole)`.
      limit_s: seconds without an answer after which it is killed.
    """

    def __init__(self, node: Node, name: str, folder: Path, limit_s: float):
        """Start the process.

        Args:
          name: for error messages.
          folder: an empty one, for what it prints.
          limit_s: seconds without an answer after which it is killed.

        Raises:
          MachineError: no process can be started.
        """
        self.name, self.limit_s = name, limit_s
        self._output_file, self._pending = folder / "output.txt", b""
        self._failure: Failure | None = None
        try:
            self._reader, writer = os.pipe()
        except OSError as error:
            raise MachineError(f"cannot start a process: {one_line(error)}") from error
        try:
            self._process = self._start(node, folder, writer)
        except BaseException:
            os.close(self._reader)
            raise
        finally:
            os.close(writer)

    def _start(self, node: Node, folder: Path, writer: int) -> child.Child:
        with writing(self._output_file):
            output = self._output_file.open("wb")
        with output:
            return child.Child(
                [str(node.file), str(_RUNNER), str(writer)],
                stdin=subprocess.PIPE,
                stdout=output,
                stderr=output,
                cwd=folder,
                pass_fds=[writer],
                preexec_fn=_die_with(os.getpid()) if sys.platform == "linux" else None,
            )

    @property
    def pid(self) -> int:
        """The process id."""
        return self._process.pid

    def call(self, request: Request[_T]) -> _T:
        """Send a request and return its answer.

        Raises:
          NodeError: the request failed, or the process crashed or did not answer in time.
        """
        if self._failure is not None:
            raise NodeError(self.name, self._failure)
        fields = {field.name: getattr(request, field.name) for field in dataclasses.fields(request)}
        line = json.dumps({"action": request.action, **fields}) + "\n"
        stdin = self._process.process.stdin
        assert stdin is not None
        with contextlib.suppress(OSError):  # its end is reported where its answer is read
            stdin.write(line.encode())
            stdin.flush()
        answer: _T = self._answer(request)
        return answer

    def time_block(self) -> int:
        """Have one block run; return its nanoseconds.

        Raises:
          NodeError: the process failed, crashed or did not answer in time.
        """
        return self.call(messages.Block()).ns

    def confine(self, allowed: Collection[int]) -> None:
        """Have the thread that steps run on these cores only; compilers of Node are others."""
        cores.confine([self.pid], allowed)

    def end(self) -> None:
        """End the process, whatever it is doing."""
        self._process.end()
        os.close(self._reader)
        stdin = self._process.process.stdin
        assert stdin is not None
        with contextlib.suppress(OSError):  # a request that was never read
            stdin.close()

    def _answer(self, request: Request[Any]) -> Any:
        content = self._line(request.activity)
        try:
            answer = json.loads(content)
            if "error" in answer:
                detail = f"{one_line(answer['error'])} while {request.activity}"
                raise NodeError(self.name, Failure(Status.FAILED, detail))
            return msgspec.convert(answer["value"], request.answer)
        except (ValueError, TypeError, KeyError, msgspec.ValidationError):
            sent = one_line(repr(content[:60]), 80)
            detail = f"sent an invalid answer, killed while {request.activity} ({sent})"
            raise self._ended(Status.CRASHED, detail) from None

    def _line(self, activity: str) -> bytes:
        """Return the next line that the process sends, without its end."""
        deadline = time.monotonic() + self.limit_s
        with selectors.DefaultSelector() as selector:
            selector.register(self._reader, selectors.EVENT_READ)
            while b"\n" not in self._pending:
                if not selector.select(max(0.0, deadline - time.monotonic())):
                    detail = f"no answer within {self.limit_s:g} s while {activity}"
                    raise self._ended(Status.TIMEOUT, detail)
                chunk = os.read(self._reader, 1 << 16)
                if not chunk or len(self._pending) > _MAX_ANSWER_BYTES:
                    raise self._ended(Status.CRASHED, f"{self._describe_end()} while {activity}")
                self._pending += chunk
        line, _, self._pending = self._pending.partition(b"\n")
        return line

    def _describe_end(self) -> str:
        code = self._process.wait(_EXIT_S)
        return "closed its pipe, killed" if code is None else child.describe_exit(code)

    def _ended(self, status: Status, detail: str) -> NodeError:
        """Kill the process; return the error that says so, and what the process last printed."""
        self._process.end()
        self._failure = Failure(status, detail + child.last_line(self._output_file))
        return NodeError(self.name, self._failure)


def _die_with(parent: int) -> Callable[[], None]:
    """Return what a child calls before it becomes Node; the end of its input ends it elsewhere."""
    return lambda: child.die_with_parent(parent)
