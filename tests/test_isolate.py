import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from mjbench import isolate

HERE = str(Path(__file__).parent)


def run(task: str, request: Any = None, limit_s: float = 60.0) -> tuple[isolate.Ended, list[Any]]:
    messages: list[Any] = []
    ended = isolate.run(f"isolated_tasks:{task}", request or {}, messages.append, limit_s, HERE)
    return ended, messages


def gone(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().split()[2] == "Z"
    except OSError:
        return True


def test_a_task_answers_with_messages() -> None:
    ended, messages = run("echo", {"a": [1, 2.5]})
    assert ended == isolate.Ended("ok")
    assert messages == [{"got": {"a": [1, 2.5]}}]


def test_bad_input_is_told_apart_from_failure() -> None:
    assert run("refuse")[0] == isolate.Ended("input", "bad file: what to do")
    ended, _ = run("fail")
    assert (ended.status, ended.detail) == ("failed", "RuntimeError: two lines")


def test_a_crash_names_the_signal_and_what_was_being_done() -> None:
    ended, messages = run("crash")
    assert ended.status == "crashed"
    assert ended.detail == "killed by signal 11 (SIGSEGV) while doing the dangerous thing"
    assert ended.where == "doing the dangerous thing"
    assert messages == [{"before": "the crash"}]


def test_an_early_exit_tells_its_code_and_last_words() -> None:
    ended, _ = run("leave")
    assert ended.status == "crashed"
    assert "exit code 7" in ended.detail
    assert "last words" in ended.detail


def test_a_silent_child_is_killed_with_its_own_children() -> None:
    ended, messages = run("hang", limit_s=1.0)
    assert ended.status == "timeout"
    assert "--time-limit" in ended.detail
    assert gone(messages[0]["grandchild"])


def test_a_child_can_ask_for_more_time_than_the_limit(tmp_path: Path) -> None:
    messages: list[Any] = []

    def answer(message: Any) -> None:
        messages.append(message)
        (tmp_path / "go").touch()

    ended = isolate.run(
        "isolated_tasks:ask_for_time", {"file": str(tmp_path / "go")}, answer, 30.0, HERE
    )
    assert ended.status == "ok"
    assert messages[-1] == {"done": True}


def test_an_exception_in_the_parent_leaves_no_child_behind() -> None:
    pids: list[int] = []

    def interrupt(message: Any) -> None:
        pids.append(message["grandchild"])
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        isolate.run("isolated_tasks:hang", {}, interrupt, 60.0, HERE)
    assert gone(pids[0])


def test_children_die_with_a_parent_that_is_killed(tmp_path: Path) -> None:
    program = (
        "import sys; from mjbench import isolate\n"
        "isolate.run('isolated_tasks:ask_for_time', {'file': '/nonexistent'},"
        f" lambda m: print(m['child'], flush=True), 60.0, {HERE!r})"
    )
    parent = subprocess.Popen(
        [sys.executable, "-c", program], stdout=subprocess.PIPE, text=True, cwd=tmp_path
    )
    assert parent.stdout is not None
    pid = int(parent.stdout.readline())
    assert not gone(pid)
    os.kill(parent.pid, signal.SIGKILL)
    parent.wait()
    parent.stdout.close()
    # the signal is on its way since wait() returned; tail waits until the process is gone
    waited = subprocess.run(["timeout", "30", "tail", f"--pid={pid}", "-f", "/dev/null"])
    assert waited.returncode == 0
