"""A Node process that steps a WebAssembly build, seen from its parent (see runner.mjs).

It does what it is asked for in an empty folder, and dies with its parent. Requests and answers are
messages of JSON (see `child_connection`); arrays are in files, as float64 of this processor.
"""

import contextlib
import json
import os
import subprocess
import sys
from collections.abc import Callable, Collection
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import msgspec

from mjbench.bounds import NonNegativeFloat, NonNegativeInt
from mjbench.errors import Failure, MachineError, one_line
from mjbench.host import child, child_connection
from mjbench.host.child_connection import ChildError
from mjbench.paired import cores
from mjbench.status import Status
from mjbench.web.node import Node

_T = TypeVar("_T")
_RUNNER = Path(__file__).with_name("runner.mjs")
# What the process can be asked for, and what it is doing then, for error messages.
_ACTIVITIES = {
    "instantiate": "instantiating the module",
    "load": "loading the model",
    "record": "stepping the model",
    "prepare": "preparing a run",
    "block": "running a block",
    "save": "saving states",
    "memory": "measuring memory",
}


@dataclass(frozen=True)
class Instantiated:
    """A build that is ready.

    Attributes:
      instantiate_ms: to compile and instantiate its WebAssembly, workers included.
      has_threadpool: whether the engine can have a thread pool of its own.
    """

    version: str
    import_ms: NonNegativeFloat
    instantiate_ms: NonNegativeFloat
    heap_bytes: NonNegativeInt
    has_threadpool: bool


@dataclass(frozen=True)
class Memory:
    """Memory of a Node process; the resident one is of the whole process."""

    heap_bytes: NonNegativeInt
    rss_bytes: NonNegativeInt


class NodeError(MachineError):
    """A Node process failed, crashed or hung; the message names it, `failure` does not."""

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
        """Start the process; the folder is an empty one, for what it prints.

        Raises:
          MachineError: no process can be started.
        """
        self.name, self.limit_s = name, limit_s
        self._failure: Failure | None = None
        self._answers = child_connection.start(
            lambda descriptor: [str(node.file), str(_RUNNER), str(descriptor)],
            folder / "output.txt",
            limit_s,
            stdin=subprocess.DEVNULL,
            cwd=folder,
            preexec_fn=_die_with(os.getpid()) if sys.platform == "linux" else None,
        )

    @property
    def pid(self) -> int:
        """The process id."""
        return self._answers.process.pid

    def call(self, kind: type[_T], action: str, **arguments: object) -> _T:
        """Have an action done, and return its answer.

        Raises:
          NodeError: the action failed, or the process crashed or did not answer in time.
        """
        if self._failure is not None:
            raise NodeError(self.name, self._failure)
        with contextlib.suppress(OSError):  # its end is reported where its answer is read
            content = json.dumps({"action": action, **arguments})
            self._answers.connection.send_bytes(content.encode())
        try:
            return self._answer(kind, _ACTIVITIES[action])
        except ChildError as error:
            self._failure = Failure(error.ending, str(error))
            raise NodeError(self.name, self._failure) from None

    def time_block(self) -> int:
        """Have one block run; return its nanoseconds.

        Raises:
          NodeError: the process failed, crashed or did not answer in time.
        """
        ns = self.call(int, "block")
        if ns <= 0:
            detail = f"reports that a block took {ns} ns"
            raise NodeError(self.name, Failure(Status.FAILED, detail))
        return ns

    def confine(self, allowed: Collection[int]) -> None:
        """Have the thread that steps run on these cores only; compilers of Node are others."""
        cores.confine([self.pid], allowed)

    def end(self) -> None:
        """End the process, whatever it is doing."""
        self._answers.end()

    def _answer(self, kind: type[_T], activity: str) -> _T:
        content = self._answers.receive(self.limit_s, activity)
        try:
            answer = json.loads(content)
            if "error" in answer:
                detail = f"{one_line(answer['error'])} while {activity}"
                raise NodeError(self.name, Failure(Status.FAILED, detail))
            return msgspec.convert(answer["value"], kind)
        except (ValueError, TypeError, KeyError, msgspec.ValidationError):
            raise self._answers.invalid(content, activity) from None


def _die_with(parent: int) -> Callable[[], None]:
    """Return what a child calls before it becomes Node; the end of its input ends it elsewhere."""
    return lambda: child.die_with_parent(parent)
