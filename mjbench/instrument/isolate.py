"""Run a function in a child process, so that a crash or a hang costs only its own rows.

The parent calls `run`; the child calls `child_main`. The request and the messages
that the child sends back are frozen dataclasses, pickled; both sides are the same code. The child
works in an empty folder (MuJoCo writes log files into the current one), its output goes to a log,
and it dies with the parent.
"""

import contextlib
import importlib
import json
import os
import pickle
import selectors
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mjbench.errors import InputError, MachineError, failure_of
from mjbench.instrument import child
from mjbench.status import Status

_ACTIVITY = "activity.json"
_STDERR = "stderr.txt"
# A message is its length in bytes, then its pickle.
_LENGTH = struct.Struct("<I")
# The child's program; its argument is the task.
_CHILD = "import sys; from mjbench.instrument.isolate import child_main; child_main(sys.argv[1])"
# How often a child's memory is checked, in seconds.
_MEMORY_CHECK_S = 0.2


@dataclass(frozen=True)
class Activity:
    """What a child is doing.

    Attributes:
      text: for people, such as `loading humanoid`; it completes "killed while …".
      index: number of the item it works on, where there are several; None otherwise.
    """

    text: str
    index: int | None = None


@dataclass(frozen=True)
class Ended:
    """How a child ended.

    Attributes:
      status: `ok`, `input` (bad input), `failed`, `crashed` or `timeout`.
      detail: one line for people; empty when ok.
      activity: what the child was doing when it crashed, failed or hung; None when unknown.
    """

    status: Status
    detail: str = ""
    activity: Activity | None = None

    def check(self) -> None:
        """Raise the error that this end stands for; return when the child ended well.

        Raises:
          InputError: the input was bad.
          MachineError: the child failed, crashed or hung.
        """
        if self.status == Status.INPUT:
            raise InputError(self.detail)
        if self.status != Status.OK:
            raise MachineError(self.detail)


@dataclass(frozen=True)
class _SilenceAllowed:
    """From the child: its next message may take this long, whatever the parent's limit."""

    seconds: float


class Channel:
    """The child's side of the conversation."""

    def __init__(self, descriptor: int):
        self._out = os.fdopen(descriptor, "wb")

    def send(self, message: object) -> None:
        """Send a message, a frozen dataclass, to the parent."""
        content = pickle.dumps(message)
        self._out.write(_LENGTH.pack(len(content)) + content)
        self._out.flush()

    def allow_silence(self, seconds: float) -> None:
        """Extend the time limit until the next message to `seconds`; it is never shortened."""
        self.send(_SilenceAllowed(seconds))

    def doing(self, text: str, index: int | None = None) -> None:
        """Record what is being done now, for the parent to read if this process dies.

        It goes to a file rather than to the parent, which would wake up beside a timed block.
        """
        Path(_ACTIVITY).write_text(json.dumps({"text": text, "index": index}), encoding="utf-8")


def run(
    task: str,
    request: object,
    on_message: Callable[[Any], None],
    limit_s: float,
    import_from: str | None = None,
    environment: Mapping[str, str | None] | None = None,
    memory_bytes: int | None = None,
) -> Ended:
    """Call the function `task` ("module:function") in a child with (request, channel).

    Args:
      task: what to call.
      request: its first argument; anything that pickles.
      on_message: called with each message as it arrives.
      limit_s: the child is killed after this long without a message.
      import_from: a further folder that the child may import from.
      environment: further environment variables of the child; None removes one.
      memory_bytes: the child is killed when it takes more memory than this.

    Returns:
      How the child ended. The child and its own children are gone by then, also when an
      exception (Ctrl-C) passes through.
    """
    with child.scratch() as folder:
        with (folder / _STDERR).open("wb") as errors:
            process = subprocess.Popen(
                [sys.executable, "-c", _CHILD, task],
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
        return end if end.status in (Status.OK, Status.INPUT) else _located(end, folder)


def _converse(
    process: "subprocess.Popen[bytes]",
    request: object,
    on_message: Callable[[Any], None],
    limit_s: float,
    memory_bytes: int | None,
) -> Ended:
    assert process.stdin is not None
    with contextlib.suppress(BrokenPipeError):
        process.stdin.write(pickle.dumps(request))
        process.stdin.close()
    for message in _messages(process, limit_s, memory_bytes):
        if isinstance(message, Ended):
            return message
        on_message(message)
    return Ended(Status.CRASHED, child.describe_exit(process.wait()))


def _messages(
    process: "subprocess.Popen[bytes]", limit_s: float, memory_bytes: int | None
) -> Iterator[Any]:
    """Yield the child's messages as they come; the last is an `Ended`, unless the child died.

    A child that is silent for too long, or takes too much memory, is an end of its own.
    """
    assert process.stdout is not None
    pending, descriptor, limit = b"", process.stdout.fileno(), limit_s
    with selectors.DefaultSelector() as selector:
        selector.register(descriptor, selectors.EVENT_READ)
        deadline, memory_checked = time.monotonic() + limit, 0.0
        while True:
            wait = max(0.0, deadline - time.monotonic())
            ready = selector.select(wait if memory_bytes is None else min(wait, _MEMORY_CHECK_S))
            now = time.monotonic()
            if memory_bytes is not None and now - memory_checked >= _MEMORY_CHECK_S:
                memory_checked = now
                if child.memory_bytes(process.pid) > memory_bytes:
                    detail = f"took more than {memory_bytes / 2**30:.1f} GiB of memory, killed"
                    yield Ended(Status.FAILED, detail)
                    return
            if not ready:
                if now < deadline:
                    continue
                detail = f"no answer within {limit:.3g} s, killed (--time-limit)"
                yield Ended(Status.TIMEOUT, detail)
                return
            chunk = os.read(descriptor, 1 << 16)
            if not chunk:
                return
            messages, pending = _split(pending + chunk)
            for message in messages:
                allowed = isinstance(message, _SilenceAllowed)
                limit = max(limit_s, message.seconds) if allowed else limit_s
                deadline = time.monotonic() + limit
                if not allowed:
                    yield message


def _split(content: bytes) -> tuple[list[Any], bytes]:
    """Return the whole messages at the beginning of `content`, and the bytes after them."""
    messages = []
    while len(content) >= _LENGTH.size:
        end = _LENGTH.size + _LENGTH.unpack_from(content)[0]
        if len(content) < end:
            break
        messages.append(pickle.loads(content[_LENGTH.size : end]))
        content = content[end:]
    return messages, content


def _located(end: Ended, folder: Path) -> Ended:
    """Return `end` with what the child was doing, and the last line it wrote to stderr."""
    try:
        activity = Activity(**json.loads(child.text(folder / _ACTIVITY)))
    except (ValueError, TypeError):  # none yet, or the child died while it wrote
        activity = None
    detail = end.detail + (f" while {activity.text}" if activity else "")
    if end.status == Status.CRASHED:
        detail += child.last_line(child.text(folder / _STDERR))
    return Ended(end.status, detail, activity)


def _environment(import_from: str | None, others: Mapping[str, str | None]) -> dict[str, str]:
    root = str(Path(__file__).resolve().parents[2])
    parts = [root, os.environ.get("PYTHONPATH", ""), import_from or ""]
    path = os.pathsep.join(p for p in parts if p)
    variables = {**os.environ, **others, "PYTHONPATH": path}
    return {name: value for name, value in variables.items() if value is not None}


def child_main(task: str) -> None:
    """Be the child: call the task, and say how it ended."""
    child.die_with_parent()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    channel = Channel(os.dup(1))
    os.dup2(2, 1)  # what the task prints goes to the log
    try:
        request = pickle.load(sys.stdin.buffer)
        module, _, function = task.partition(":")
        getattr(importlib.import_module(module), function)(request, channel)
        end = Ended(Status.OK)
    except Exception as error:
        failure = failure_of(error)
        end = Ended(failure.status, failure.detail)
    channel.send(end)
    os._exit(0)  # nothing here needs a tidy shutdown, and some engines hang in theirs
