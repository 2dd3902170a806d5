import errno
import os
import pickle
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import isolated_tasks
import pytest
from commands import TESTS
from isolated_tasks import Blob, BlobsRequest, Process, Text, WaitRequest, add
from process_tree import ends

from mjbench.errors import InputError, MachineError, UnavailableError
from mjbench.host import child_connection, isolate
from mjbench.host.child_connection import ChildConnection
from mjbench.host.isolate import Ended
from mjbench.status import Status

# The parent reads from a child in chunks of this many bytes.
CHUNK = 1 << 16
Connect = Callable[..., ChildConnection]


def run(task: str, request: Any = None, limit_s: float = 60.0) -> tuple[Ended, list[Any]]:
    """Return how a task ended, and the messages that it sent."""
    messages: list[Any] = []
    ended = isolate.run(
        getattr(isolated_tasks, task), (request,), messages.append, limit_s, str(TESTS)
    )
    return ended, messages


def test_a_task_receives_its_request_and_answers_with_messages() -> None:
    ended, messages = run("echo", Text("1, 2.5"))
    assert ended == Ended(Status.OK)
    assert messages == [Text("1, 2.5")]


def test_a_call_returns_what_its_function_returns_in_a_child(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("PYTHONPATH", str(TESTS))
    total, pid = isolate.call(add, 1, 2.5, limit_s=60.0)
    assert total == 3.5
    assert pid != os.getpid()


def test_a_call_that_fails_raises_or_returns_what_stands_for_its_end(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("PYTHONPATH", str(TESTS))
    with pytest.raises(InputError, match="1 is not to be added to 1"):
        isolate.call(add, 1, 1.0, limit_s=60.0)
    ended = isolate.call(add, 1, 1.0, limit_s=60.0, otherwise=lambda ended: (0.0, ended))
    assert ended == (0.0, Ended(Status.INPUT, "1 is not to be added to 1"))


# messages


def test_messages_around_and_above_the_size_of_a_chunk_arrive_whole_and_in_order() -> None:
    sizes = (1, 3 * CHUNK + 1, 0, CHUNK - 1, CHUNK, CHUNK + 1, 10 * CHUNK, 5)
    ended, messages = run("send_blobs", BlobsRequest(sizes))
    assert ended == Ended(Status.OK)
    assert messages == [Blob.of(index, size) for index, size in enumerate(sizes)]


def test_a_task_that_breaks_the_pipe_of_messages_ends_in_one_line(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(child_connection, "_EXIT_S", 0.1)
    ended, _ = run("close_every_descriptor")
    assert ended.status == Status.CRASHED
    assert "Bad file descriptor" in ended.detail
    assert "\n" not in ended.detail
    assert "something strange" in ended.detail


@pytest.mark.parametrize("task", ["print_everywhere", "close_outputs", "change_folder", "fork"])
def test_what_a_task_does_to_its_process_leaves_the_messages_whole(task: str) -> None:
    ended, messages = run(task)
    assert ended == Ended(Status.OK)
    assert messages == [Text("before"), Text("after")]


def test_what_a_program_prints_when_it_starts_is_no_message(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "sitecustomize.py").write_text("print('welcome')")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    ended, messages = run("echo", Text("1, 2.5"))
    assert ended == Ended(Status.OK)
    assert messages == [Text("1, 2.5")]


@pytest.mark.parametrize("name", ["SystemExit", "KeyboardInterrupt"])
def test_a_task_that_ends_its_interpreter_fails_and_says_how(name: str) -> None:
    ended, _ = run("raise_exception", Text(name))
    assert ended == Ended(Status.FAILED, f"{name}: 3")


# how a child ends


def test_bad_input_and_failure_are_distinguished() -> None:
    refused, _ = run("refuse")
    assert refused == Ended(Status.INPUT, "bad file: what to do")
    failed, _ = run("fail")
    assert failed.status == Status.FAILED
    assert failed.detail == "RuntimeError: two lines while work that fails"


@pytest.mark.parametrize("status", [Status.FAILED, Status.CRASHED, Status.TIMEOUT])
def test_an_end_that_is_not_ok_is_an_error_of_the_machine(status: Status) -> None:
    with pytest.raises(MachineError, match="why"):
        Ended(status, "why").check()


def test_a_refusal_is_an_error_of_the_input_and_ok_is_none() -> None:
    with pytest.raises(InputError, match="why"):
        Ended(Status.INPUT, "why").check()
    with pytest.raises(UnavailableError, match="why"):
        Ended(Status.UNAVAILABLE, "why").check()
    Ended(Status.OK).check()


def test_a_crash_names_the_signal_and_the_activity_with_its_index() -> None:
    ended, messages = run("crash")
    assert ended.status == Status.CRASHED
    assert ended.detail == "killed by signal 11 (SIGSEGV) while something dangerous"
    assert ended.position == 3
    assert messages == [Text("before the crash")]


def test_a_silent_child_is_killed_with_its_own_children() -> None:
    children: list[int] = []

    def watch(message: Process) -> None:
        children.append(os.pidfd_open(message.pid))

    ended = isolate.run(isolated_tasks.hang, (None,), watch, 1.0, str(TESTS))
    assert ended.status == Status.TIMEOUT
    assert "--time-limit" in ended.detail
    assert ended.position == 0
    (grandchild,) = children
    assert ends(grandchild)


def test_a_process_that_cannot_be_started_is_an_error_of_the_machine(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def refuse(*arguments: object, **named: object) -> None:
        raise BlockingIOError(errno.EAGAIN, "Resource temporarily unavailable")

    monkeypatch.setattr(subprocess, "Popen", refuse)
    with pytest.raises(MachineError, match="cannot start a process"):
        run("echo", Text(""))


def test_allowed_silence_is_no_message_for_the_parent(tmp_path: Path) -> None:
    messages: list[Any] = []

    def answer(message: Any) -> None:
        messages.append(message)
        (tmp_path / "go").touch()

    request = WaitRequest(tmp_path / "go")
    ended = isolate.run(isolated_tasks.wait_for_file, (request,), answer, 30.0, str(TESTS))
    assert ended == Ended(Status.OK)
    assert [type(message) for message in messages] == [Process, Text]


class SimulatedChild:
    """A child, and its connection, whose messages arrive at given times of a simulated clock."""

    pid = 1

    def __init__(self, *arrivals: tuple[float, object]):
        self.now, self.arrivals = 0.0, list(arrivals)

    def send(self, request: object) -> None: ...

    def poll(self) -> bool:
        return self.arrivals[0][0] <= self.now

    def await_message(self, awaited: object, wait_s: float) -> list[object]:
        """Let simulated time pass until the next message, or for as long as the parent waits."""
        self.now = max(self.now, min(self.arrivals[0][0], self.now + wait_s))
        return [self] if self.poll() else []

    def recv_bytes(self, max_bytes: int) -> bytes:
        arrived = self.arrivals.pop(0)[1]
        if isinstance(arrived, Exception):
            raise arrived
        return arrived if isinstance(arrived, bytes) else pickle.dumps(arrived)

    def wait(self, timeout_s: float) -> None: ...

    def end(self) -> None: ...


@pytest.fixture
def connect(monkeypatch: pytest.MonkeyPatch) -> Connect:
    """Return what makes the connection to a child whose messages arrive at given times."""

    def connected(*arrivals: tuple[float, object]) -> ChildConnection:
        child: Any = SimulatedChild(*arrivals, (1e9, Ended(Status.OK)))
        monkeypatch.setattr(child_connection, "monotonic", lambda: child.now)
        monkeypatch.setattr(child_connection, "wait", child.await_message)
        return ChildConnection(child, child, Path("log"))

    return connected


def received(connection: ChildConnection) -> list[str]:
    """Return what the parent receives; a child that is killed is `timeout`."""
    messages: list[str] = []
    ended = isolate._converse(connection, None, lambda m: messages.append(m.text), 3.0, None)
    return [*messages, ended.status.value]


@pytest.mark.parametrize(
    ("arrival", "ended"),
    [
        (b"hello", Ended(Status.CRASHED, "sent an invalid answer (b'hello'), killed")),
        (EOFError(), Ended(Status.CRASHED, "closed its connection, killed")),
        (
            BlockingIOError(),
            Ended(Status.TIMEOUT, "sent part of an answer, then nothing, killed (--time-limit)"),
        ),
    ],
)
def test_a_child_that_sends_no_whole_message_ends_in_words_that_say_so(
    connect: Connect, arrival: object, ended: Ended
) -> None:
    connection = connect((0.0, arrival))
    assert isolate._converse(connection, None, lambda m: None, 3.0, None) == ended


@pytest.mark.parametrize(("allowed_s", "expected"), [(None, []), (4.0, []), (6.0, ["late"])])
def test_a_child_can_extend_its_time_limit(
    connect: Connect, allowed_s: float | None, expected: list[str]
) -> None:
    allowed = [] if allowed_s is None else [(0.0, isolate._SilenceAllowed(allowed_s))]
    assert received(connect(*allowed, (5.0, Text("late")))) == [*expected, "timeout"]


def test_an_extension_ends_with_the_next_message(connect: Connect) -> None:
    extension = isolate._SilenceAllowed(100.0)
    arrivals = (0.0, extension), (90.0, Text("late")), (95.0, Text("too late"))
    assert received(connect(*arrivals)) == ["late", "timeout"]


def test_an_extension_never_shortens_the_limit(connect: Connect) -> None:
    extension = isolate._SilenceAllowed(1.0)
    connection = connect((0.0, extension), (2.0, Text("in time")))
    assert received(connection) == ["in time", "timeout"]


def test_a_child_is_killed_when_its_share_of_the_time_ends(
    connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    connection = connect((5.0, Text("in time")), (9.0, Text("late")))
    monkeypatch.setattr(isolate, "monotonic", child_connection.monotonic)
    texts: list[str] = []
    ended = isolate._converse(
        connection, None, lambda message: texts.append(message.text), 60.0, None, end_s=8.0
    )
    assert texts == ["in time"]
    assert ended == Ended(Status.TIMEOUT, "killed after 8 s (its share of --budget)")


def test_a_child_that_takes_too_much_memory_is_killed(
    connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(isolate.child, "memory_bytes", lambda pid: 3 << 30)
    ended = isolate._converse(connect((5.0, Text("late"))), None, lambda m: None, 60.0, 2 << 30)
    assert ended == Ended(Status.FAILED, "took more than 2.0 GiB of memory, killed")
