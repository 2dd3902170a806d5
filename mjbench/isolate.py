"""Run a function in a process of its own, so that a crash or a hang costs only its own rows.

The parent calls `run`; the child is this module run as a program. The child works in an empty
folder (MuJoCo leaves log files where it stands), its output is kept out of the user's sight, and
it dies with the parent. What it has to say comes as JSON messages, one a line.
"""

import contextlib
import importlib
import json
import os
import selectors
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mjbench import child
from mjbench.errors import told

Message = dict[str, Any]
_WHERE = "where.txt"
_STDERR = "stderr.txt"
_END = "__end__"
_LIMIT = "__limit__"
# How often a child's memory is looked at, in seconds.
_LOOK_S = 0.2


@dataclass(frozen=True)
class Ended:
    """How a child ended.

    Attributes:
      status: `ok`, `input` (bad input), `failed`, `crashed` or `timeout`.
      detail: one line for people; empty when ok.
      where: what the child was last doing, by its own word.
    """

    status: str
    detail: str = ""
    where: str = ""


class Channel:
    """The child's side of the conversation."""

    def __init__(self, descriptor: int):
        self._out = os.fdopen(descriptor, "w", encoding="utf-8")

    def send(self, **message: Any) -> None:
        """Send a message to the parent."""
        self._out.write(json.dumps(message) + "\n")
        self._out.flush()

    def expect(self, seconds: float) -> None:
        """Say that the next message may take this long, however short the parent's limit."""
        self.send(**{_LIMIT: seconds})

    def where(self, text: str) -> None:
        """Note what is being done now, for the parent to read should this process die."""
        Path(_WHERE).write_text(text, encoding="utf-8")


def run(
    task: str,
    request: Message,
    on_message: Callable[[Message], None],
    limit_s: float,
    import_from: str | None = None,
    environment: Mapping[str, str | None] | None = None,
    memory_bytes: int | None = None,
) -> Ended:
    """Call the function `task` ("module:function") in a child with (request, channel).

    Args:
      task: what to call.
      request: JSON-ready argument.
      on_message: called with each message as it arrives.
      limit_s: the child is killed after this long without a message.
      import_from: a further folder that the child may import from.
      environment: further environment variables of the child; None removes one.
      memory_bytes: the child is killed when it has more than this in memory.

    Returns:
      How the child ended. The child and its own children are gone by then, also when an
      exception (Ctrl-C) passes through.
    """
    with child.scratch() as folder:
        with (folder / _STDERR).open("wb") as errors:
            process = subprocess.Popen(
                [sys.executable, "-m", "mjbench.isolate", task],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=errors,
                cwd=folder,
                env=_environment(import_from, environment or {}),
                start_new_session=True,
            )
        try:
            end = _converse(process, request, on_message, limit_s, memory_bytes)
        finally:
            child.end_group(process)
            for stream in filter(None, (process.stdin, process.stdout)):
                with contextlib.suppress(OSError):  # a request that was never read
                    stream.close()
        return end if end.status in ("ok", "input") else _located(end, folder)


def _converse(
    process: "subprocess.Popen[bytes]",
    request: Message,
    on_message: Callable[[Message], None],
    limit_s: float,
    memory_bytes: int | None,
) -> Ended:
    assert process.stdin is not None
    with contextlib.suppress(BrokenPipeError):
        process.stdin.write(json.dumps(request).encode())
        process.stdin.close()
    for message in _messages(process, limit_s, memory_bytes):
        if _END in message:
            return Ended(message[_END], message["detail"])
        on_message(message)
    return Ended("crashed", child.cause_of_death(process.wait()))


def _messages(
    process: "subprocess.Popen[bytes]", limit_s: float, memory_bytes: int | None
) -> Iterator[Message]:
    """Yield the child's messages as they come; when none comes in time, an end of `timeout`.

    A message that only asks for more time until the next one is not passed on. A child that takes
    more memory than it may is an end of `failed`.
    """
    assert process.stdout is not None
    pending, descriptor, limit = b"", process.stdout.fileno(), limit_s
    with selectors.DefaultSelector() as selector:
        selector.register(descriptor, selectors.EVENT_READ)
        deadline, looked = time.monotonic() + limit, 0.0
        while True:
            left = max(0.0, deadline - time.monotonic())
            look = left if memory_bytes is None else min(left, _LOOK_S)
            ready = selector.select(look)
            now = time.monotonic()
            if memory_bytes is not None and now - looked >= _LOOK_S:
                looked = now
                if child.memory_bytes(process.pid) > memory_bytes:
                    detail = f"took more than {memory_bytes / 2**30:.1f} GiB of memory, killed"
                    yield {_END: "failed", "detail": detail}
                    return
            if not ready:
                if now < deadline:
                    continue
                detail = f"no answer within {limit:.3g} s, killed (--time-limit)"
                yield {_END: "timeout", "detail": detail}
                return
            chunk = os.read(descriptor, 1 << 16)
            if not chunk:
                return
            *lines, pending = (pending + chunk).split(b"\n")
            for message in map(json.loads, lines):
                limit = max(limit_s, message.get(_LIMIT, 0.0))
                deadline = time.monotonic() + limit
                if _LIMIT not in message:
                    yield message


def _located(end: Ended, folder: Path) -> Ended:
    """Return `end` with what the child was doing, and the last line it wrote to stderr."""
    where = child.text(folder / _WHERE).strip()
    detail = end.detail + (f" while {where}" if where else "")
    if end.status == "crashed":
        detail += child.last_words(child.text(folder / _STDERR))
    return Ended(end.status, detail, where)


def _environment(import_from: str | None, others: Mapping[str, str | None]) -> dict[str, str]:
    root = str(Path(__file__).resolve().parent.parent)
    parts = [root, os.environ.get("PYTHONPATH", ""), import_from or ""]
    path = os.pathsep.join(p for p in parts if p)
    found = {**os.environ, **others, "PYTHONPATH": path}
    return {name: value for name, value in found.items() if value is not None}


def _child_main(task: str) -> None:
    """Be the child: call the task, and say how it ended."""
    child.die_with_parent()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    channel = Channel(os.dup(1))
    os.dup2(2, 1)  # whatever prints, prints to the log
    request = json.load(sys.stdin)
    module, _, function = task.partition(":")
    try:
        getattr(importlib.import_module(module), function)(request, channel)
        end = ("ok", "")
    except Exception as error:
        end = told(error)
    channel.send(**{_END: end[0]}, detail=end[1])
    os._exit(0)  # nothing here needs a tidy shutdown, and some engines hang in theirs


if __name__ == "__main__":
    _child_main(sys.argv[1])
