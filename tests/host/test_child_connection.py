"""What a child sends, and how it fails to: in the same words for all that answer over one."""

import contextlib
import multiprocessing.connection
import pickle
import signal
import struct
import sys
from pathlib import Path
from typing import Any

import pytest

from mjbench.host import child_connection
from mjbench.host.child_connection import ChildConnection, ChildError
from mjbench.status import Status

# What a child runs first: `here` is its end of the connection.
PREAMBLE = """
import os, signal, sys, time
from multiprocessing.connection import Connection
here = Connection(int(sys.argv[1]))
"""


def started(folder: Path, code: str, limit_s: float = 60.0) -> ChildConnection:
    """Return the connection to a child that runs some code."""

    def command(descriptor: int) -> list[str]:
        return [sys.executable, "-c", PREAMBLE + code, str(descriptor)]

    return child_connection.start(command, folder / "output.txt", limit_s)


def failure(folder: Path, code: str, limit_s: float = 60.0) -> ChildError:
    """Return how a child fails that runs some code."""
    connection = started(folder, code)
    try:
        with pytest.raises(ChildError) as caught:
            connection.receive(limit_s, "stepping the model")
        assert connection.process.wait(60.0) is not None
    finally:
        connection.end()
    return caught.value


def test_messages_go_both_ways(tmp_path: Path) -> None:
    connection = started(tmp_path, "here.send(here.recv() + 1)")
    connection.connection.send(41)
    assert connection.unpickled(connection.receive(60.0), "", int) == 42
    connection.end()


@pytest.mark.parametrize(
    ("code", "ending", "message"),
    [
        ("os.kill(os.getpid(), signal.SIGKILL)", Status.CRASHED, "killed by signal 9 (SIGKILL)"),
        ("sys.exit(3)", Status.CRASHED, "the process ended with exit code 3"),
        (
            "os.write(here.fileno(), b'printed by a library'); time.sleep(600)",
            Status.CRASHED,
            "sent an invalid answer, killed",
        ),
        ("here.close(); time.sleep(600)", Status.CRASHED, "closed its connection, killed"),
        (  # what it forked keeps its end of the connection open
            "os.fork() and sys.exit(3); time.sleep(600)",
            Status.CRASHED,
            "the process ended with exit code 3",
        ),
    ],
)
def test_a_child_that_fails_is_described_with_what_it_was_doing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: str, ending: Status, message: str
) -> None:
    monkeypatch.setattr(child_connection, "_EXIT_S", 0.1 if "sleep" in code else 60.0)
    error = failure(tmp_path, "print('last words', flush=True); " + code)
    assert (error.ending, error.cause) == (ending, message)
    assert str(error) == f"{message} while stepping the model; its last output: last words"


def test_a_child_that_sends_nothing_is_killed(tmp_path: Path) -> None:
    error = failure(tmp_path, "time.sleep(600)", limit_s=0.01)
    assert error.ending == Status.TIMEOUT
    assert str(error) == "no answer within 0.01 s while stepping the model"


def test_what_watches_a_silent_child_can_end_the_wait(tmp_path: Path) -> None:
    connection = started(tmp_path, "time.sleep(600)")

    def watch() -> None:
        raise connection.failure(Status.FAILED, "it takes too much")

    with pytest.raises(ChildError, match=r"^it takes too much$"):
        connection.receive(60.0, watch=watch)
    assert connection.process.wait(0.0) == -signal.SIGKILL
    connection.end()


def test_what_watches_takes_time_of_the_limit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    connection = started(tmp_path, "time.sleep(600)")
    now_s, seen_s = 0.0, list[float]()
    monkeypatch.setattr(child_connection, "_WATCH_S", 0.0)
    monkeypatch.setattr(child_connection, "monotonic", lambda: now_s)

    def watch() -> None:
        nonlocal now_s
        seen_s.append(now_s)
        now_s += 40.0

    with pytest.raises(ChildError, match="no answer within 60 s"):
        connection.receive(60.0, watch=watch)
    assert seen_s == [0.0, 40.0]
    connection.end()


@pytest.mark.skipif(sys.platform != "linux", reason="needs pidfd_open")
@pytest.mark.parametrize("code", ["here.recv(); here.send(1)", "here.recv(); sys.exit(3)"])
def test_nothing_wakes_up_before_a_child_answers_or_ends(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: str
) -> None:
    connection, waits_s = started(tmp_path, code), list[float]()

    def wait(handles: list[Any], timeout_s: float) -> list[Any]:
        waits_s.append(timeout_s)
        return multiprocessing.connection.wait(handles, timeout_s)

    monkeypatch.setattr(child_connection, "wait", wait)
    monkeypatch.setattr(child_connection, "_WATCH_S", 0.0)
    connection.connection.send(None)
    with contextlib.suppress(ChildError):
        connection.receive(60.0)
    assert len(waits_s) == 1
    connection.end()


@pytest.mark.parametrize("content", [b"oops", pickle.dumps("text")[:-3], pickle.dumps("text")])
def test_what_is_no_answer_of_its_kind_ends_the_child(tmp_path: Path, content: bytes) -> None:
    connection = started(tmp_path, "time.sleep(600)")
    with pytest.raises(ChildError, match=r"invalid answer \(.*\), killed while counting") as caught:
        connection.unpickled(content, "counting", int)
    assert "\n" not in str(caught.value)
    assert connection.process.wait(0.0) == -signal.SIGKILL
    connection.end()


def test_a_message_that_never_ends_is_given_up(tmp_path: Path) -> None:
    begin = b"\0\0\1\0only the beginning"
    connection = started(tmp_path, f"os.write(here.fileno(), {begin!r}); time.sleep(600)", 0.01)
    with pytest.raises(ChildError, match="sent part of an answer, then nothing") as caught:
        connection.receive(60.0)
    assert caught.value.ending == Status.TIMEOUT
    connection.end()


def test_the_longest_silence_within_a_message_is_given_to_the_system_in_its_format() -> None:
    assert child_connection.timeval(2.5) == struct.pack("@ll", 2, 500_000)
