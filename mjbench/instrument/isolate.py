"""Run a function in a child process, so that a crash or a hang costs only its own rows.

The parent calls `run`; the child calls `child_main`. The request and the messages
that the child sends back are frozen dataclasses, pickled; both sides are the same code. The child
works in an empty folder (MuJoCo writes log files into the current one), and it dies with the
parent. Messages have a pipe of their own: all that the child writes to its output goes to a log.
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

from mjbench.errors import InputError, MachineError, failure_of, one_line, writing
from mjbench.instrument import child, scratch
from mjbench.status import Status

_ACTIVITY = "activity.json"
_LOG = "output.txt"
# A message is this header and its pickle. The header holds a fixed word, which other bytes in the
# pipe hardly have, and the length of the pickle in bytes.
_HEADER, _WORD = struct.Struct("<4sI"), b"mjb\n"
# No message is nearly as long.
_MAX_MESSAGE_BYTES = 1 << 26
# The child's program; its arguments are the task, the pipe for messages, and the parent.
_CHILD = "import sys; from mjbench.instrument.isolate import child_main; child_main(*sys.argv[1:])"
# How often a child's memory is checked, in seconds.
_MEMORY_CHECK_S = 0.2
# A child that has closed its pipe has ended, or does within this many seconds.
_EXIT_S = 5.0


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


class _GarbageError(Exception):
    """What came through the pipe is not a message."""


class Channel:
    """The child's side of the conversation."""

    def __init__(self, descriptor: int):
        self._out = os.fdopen(descriptor, "wb")
        self._pid = os.getpid()
        self._activity_file = Path.cwd() / _ACTIVITY  # the task may change the folder

    def send(self, message: object) -> None:
        """Send a message, a frozen dataclass, to the parent."""
        if os.getpid() != self._pid:  # a fork that the task did not end, and that runs on
            os._exit(1)
        content = pickle.dumps(message)
        self._out.write(_HEADER.pack(_WORD, len(content)) + content)
        self._out.flush()

    def allow_silence(self, seconds: float) -> None:
        """Extend the time limit until the next message to `seconds`; it is never shortened."""
        self.send(_SilenceAllowed(seconds))

    def doing(self, text: str, index: int | None = None) -> None:
        """Record what is being done now, for the parent to read if this process dies.

        It goes to a file rather than to the parent, which would wake up beside a timed block. A
        full disk costs this record, not the work.
        """
        with contextlib.suppress(OSError):
            content = json.dumps({"text": text, "index": index})
            self._activity_file.write_text(content, encoding="utf-8")


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
      request: its first argument; anything that pickles.
      on_message: called with each message as it arrives.
      limit_s: the child is killed after this long without a message.
      import_from: a further folder that the child may import from.
      environment: further environment variables of the child; None removes one.
      memory_bytes: the child is killed when it takes more memory than this.

    Returns:
      How the child ended. The child and all that it started are gone by then, also when an
      exception (Ctrl-C) passes through.

    Raises:
      MachineError: no process can be started, or its files cannot be written.
    """
    with scratch.folder() as folder:
        reader, process = _start(task, folder, _environment(import_from, environment or {}))
        try:
            end = _converse(process.process, reader, request, on_message, limit_s, memory_bytes)
        finally:
            process.end()
            os.close(reader)
            with contextlib.suppress(OSError):  # a request that was never read
                assert process.process.stdin is not None
                process.process.stdin.close()
        return end if end.status in (Status.OK, Status.INPUT) else _located(end, folder)


def _start(task: str, folder: Path, environment: Mapping[str, str]) -> tuple[int, child.Child]:
    """Start the child in a folder; return the pipe that its messages come from, and the child."""
    try:
        reader, writer = os.pipe()
    except OSError as error:
        raise MachineError(f"cannot start a process: {one_line(error)}") from error
    try:
        with writing(folder / _LOG), (folder / _LOG).open("wb") as log:
            process = child.Child(
                [sys.executable, "-c", _CHILD, task, str(writer), str(os.getpid())],
                stdin=subprocess.PIPE,
                stdout=log,
                stderr=log,
                cwd=folder,
                env=environment,
                pass_fds=[writer],
            )
    except BaseException:
        os.close(reader)
        raise
    finally:
        os.close(writer)
    return reader, process


def _converse(
    process: "subprocess.Popen[bytes]",
    reader: int,
    request: object,
    on_message: Callable[[Any], None],
    limit_s: float,
    memory_bytes: int | None,
) -> Ended:
    assert process.stdin is not None
    with contextlib.suppress(BrokenPipeError):
        process.stdin.write(pickle.dumps(request))
        process.stdin.close()
    try:
        for message in _messages(process.pid, reader, limit_s, memory_bytes):
            if isinstance(message, Ended):
                return message
            on_message(message)
        return Ended(Status.CRASHED, child.describe_exit(process.wait(_EXIT_S)))
    except _GarbageError as error:
        return Ended(Status.CRASHED, f"sent an invalid message ({error}), killed")
    except subprocess.TimeoutExpired:
        return Ended(Status.CRASHED, "closed the pipe for its messages, killed")


def _messages(pid: int, reader: int, limit_s: float, memory_bytes: int | None) -> Iterator[Any]:
    """Yield the child's messages as they come; the last is an `Ended`, unless the child died.

    A child that is silent for too long, or takes too much memory, is an end of its own.

    Raises:
      _GarbageError: something else than a message came.
    """
    pending, limit = b"", limit_s
    with selectors.DefaultSelector() as selector:
        selector.register(reader, selectors.EVENT_READ)
        deadline, memory_checked = time.monotonic() + limit, 0.0
        while True:
            wait = max(0.0, deadline - time.monotonic())
            ready = selector.select(wait if memory_bytes is None else min(wait, _MEMORY_CHECK_S))
            now = time.monotonic()
            if memory_bytes is not None and now - memory_checked >= _MEMORY_CHECK_S:
                memory_checked = now
                if child.memory_bytes(pid) > memory_bytes:
                    detail = f"took more than {memory_bytes / 2**30:.1f} GiB of memory, killed"
                    yield Ended(Status.FAILED, detail)
                    return
            if not ready:
                if now < deadline:
                    continue
                detail = f"no answer within {limit:.3g} s, killed (--time-limit)"
                yield Ended(Status.TIMEOUT, detail)
                return
            chunk = os.read(reader, 1 << 16)
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
    """Return the whole messages at the beginning of `content`, and the bytes after them.

    Raises:
      _GarbageError: it begins with something else.
    """
    messages = []
    while len(content) >= _HEADER.size:
        word, length = _HEADER.unpack_from(content)
        if word != _WORD or length > _MAX_MESSAGE_BYTES:
            raise _GarbageError(one_line(repr(content[:20])))
        end = _HEADER.size + length
        if len(content) < end:
            break
        messages.append(_unpickled(content[_HEADER.size : end]))
        content = content[end:]
    return messages, content


def _unpickled(content: bytes) -> Any:
    try:
        return pickle.loads(content)
    except Exception as error:  # damaged bytes raise whatever they spell
        raise _GarbageError(f"{type(error).__name__}: {one_line(error, 100)}") from error


def _located(end: Ended, folder: Path) -> Ended:
    """Return `end` with what the child was doing, and the last line it wrote to stderr."""
    try:
        activity = Activity(**json.loads(child.text(folder / _ACTIVITY)))
    except (ValueError, TypeError):  # none yet, or the child died while it wrote
        activity = None
    detail = end.detail + (f" while {activity.text}" if activity else "")
    if end.status == Status.CRASHED:
        detail += child.last_line(folder / _LOG)
    return Ended(end.status, detail, activity)


def _environment(import_from: str | None, others: Mapping[str, str | None]) -> dict[str, str]:
    root = str(Path(__file__).resolve().parents[2])
    parts = [root, os.environ.get("PYTHONPATH", ""), import_from or ""]
    path = os.pathsep.join(p for p in parts if p)
    variables = {**os.environ, **others, "PYTHONPATH": path}
    return {name: value for name, value in variables.items() if value is not None}


def child_main(task: str, descriptor: str, parent: str) -> None:
    """Be the child: call the task, and say how it ended.

    Args:
      descriptor: of the pipe for messages.
    """
    child.die_with_parent(int(parent))
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.set_inheritable(int(descriptor), False)
    channel = Channel(int(descriptor))
    try:
        request = pickle.load(sys.stdin.buffer)
        module, _, function = task.partition(":")
        getattr(importlib.import_module(module), function)(request, channel)
        end = Ended(Status.OK)
    except BaseException as error:  # a path of the user's own may raise SystemExit
        failure = failure_of(error)
        end = Ended(failure.status, failure.detail)
    try:
        channel.send(end)
    except OSError as error:
        print(failure_of(error).detail, file=sys.stderr, flush=True)  # noqa: T201  the log
        os._exit(1)
    os._exit(0)  # nothing here needs a tidy shutdown, and some engines hang in theirs
