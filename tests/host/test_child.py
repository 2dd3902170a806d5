"""Children end with all that they started, and with their parent; others live on."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import isolated_tasks
import pytest
from commands import TESTS, python, started
from isolated_tasks import Process
from process_tree import ends

from mjbench.host import child, isolate


@pytest.mark.parametrize("task", ["start_a_session", "leave_a_daemon"])
def test_what_a_child_started_in_another_session_ends_with_it(task: str) -> None:
    started: list[int] = []

    def watch(message: Process) -> None:
        started.append(os.pidfd_open(message.pid))
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        isolate.run(getattr(isolated_tasks, task), (None,), watch, 60.0, str(TESTS))
    (process,) = started
    assert ends(process)


@pytest.mark.parametrize(("task", "count"), [("wait_for_file", 1), ("step_with_processes", 2)])
def test_children_die_with_a_parent_that_is_killed(tmp_path: Path, task: str, count: int) -> None:
    program = (
        "from pathlib import Path\n"
        "import isolated_tasks\n"
        "from mjbench.host import isolate\n"
        "request = isolated_tasks.WaitRequest(Path('/nonexistent'))\n"
        f"isolate.run(isolated_tasks.{task}, (request,),"
        f" lambda message: print(message.pid, flush=True), 60.0, {str(TESTS)!r})"
    )
    parent = started("-c", program, cwd=tmp_path, stderr=None)
    processes = [os.pidfd_open(int(parent.stdout.readline())) for _ in range(count)]
    parent.kill()
    parent.wait()
    parent.stdout.close()
    assert all(map(ends, processes))


def test_a_child_whose_parent_has_ended_before_it_could_ask_to_die_with_it_ends() -> None:
    program = "from mjbench.host import child; child.die_with_parent(1 << 22); print('on')"
    done = python("-c", program)
    assert (done.returncode, done.stdout) == (1, "")


def test_a_program_that_knows_nothing_of_it_ends_with_its_parent() -> None:
    program = (
        "import subprocess\n"
        "from mjbench.host import child\n"
        "shell = ['sh', '-c', 'echo $$; exec sleep 600']\n"
        "subprocess.run(child.ending_with_parent(shell))"
    )
    parent = started("-c", program, stderr=None)
    process = os.pidfd_open(int(parent.stdout.readline()))
    parent.kill()
    parent.communicate()
    assert ends(process)


def test_a_program_whose_parent_has_ended_is_not_started(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "getpid", lambda: 1 << 22)
    command = child.ending_with_parent(["echo", "on"])
    monkeypatch.undo()
    assert subprocess.run(command, capture_output=True, check=True).stdout == b""


@pytest.mark.parametrize("name", ["SIGPIPE", "SIGXFSZ"])
def test_a_program_that_ends_with_its_parent_has_the_usual_signals(name: str) -> None:
    number = getattr(signal, name).value
    command = child.ending_with_parent(["sh", "-c", f"kill -{number} $$"])
    assert subprocess.run(command, check=False).returncode == -number


def test_what_others_have_started_below_this_process_lives_on() -> None:
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as neighbour:
        mine = child.Child([sys.executable, "-c", "import time; time.sleep(600)"])
        ended = os.pidfd_open(mine.process.pid)
        child.end_descendants()
        assert ends(ended)
        mine.end()
        assert neighbour.poll() is None
        neighbour.communicate(b"\n")
    assert neighbour.returncode == 0


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP", "SIGALRM"])
def test_an_interrupt_waits_until_a_process_has_started_and_then_ends_it(
    monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    number = getattr(signal, name)
    started: list[subprocess.Popen[bytes]] = []

    class Interrupted(subprocess.Popen[bytes]):
        def __init__(self, *arguments: object, **options: object) -> None:
            signal.raise_signal(number)  # before it has a mark, or anybody knows it
            super().__init__(*arguments, **options)  # type: ignore[call-overload]
            started.append(self)

    monkeypatch.setattr(subprocess, "Popen", Interrupted)
    before = signal.signal(number, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            child.Child([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
        assert signal.getsignal(number) is signal.default_int_handler
    finally:
        signal.signal(number, before)
    assert started[0].stdin.closed
    assert [process.returncode for process in started] == [-signal.SIGKILL]
