import os
import select
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import pytest
from commands import TESTS

from mjbench.instrument import child, isolate

HERE = str(TESTS)


def run(task: str, request: Any = None, limit_s: float = 60.0) -> tuple[isolate.Ended, list[Any]]:
    messages: list[Any] = []
    ended = isolate.run(f"isolated_tasks:{task}", request or {}, messages.append, limit_s, HERE)
    return ended, messages


def ends(process: int) -> bool:
    """Return whether the process behind a pidfd ends; the wait is only for a test that fails."""
    ready, _, _ = select.select([process], [], [], 60.0)
    os.close(process)
    return bool(ready)


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
    children: list[int] = []
    ended = isolate.run(
        "isolated_tasks:hang",
        {},
        lambda message: children.append(os.pidfd_open(message["grandchild"])),
        1.0,
        HERE,
    )
    assert ended.status == "timeout"
    assert "--time-limit" in ended.detail
    assert ends(children[0])


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
    children: list[int] = []

    def interrupt(message: Any) -> None:
        children.append(os.pidfd_open(message["grandchild"]))
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        isolate.run("isolated_tasks:hang", {}, interrupt, 60.0, HERE)
    assert ends(children[0])


def test_children_die_with_a_parent_that_is_killed(tmp_path: Path) -> None:
    program = (
        "from mjbench.instrument import isolate\n"
        "isolate.run('isolated_tasks:ask_for_time', {'file': '/nonexistent'},"
        f" lambda m: print(m['child'], flush=True), 60.0, {HERE!r})"
    )
    parent = subprocess.Popen(
        [sys.executable, "-c", program], stdout=subprocess.PIPE, text=True, cwd=tmp_path
    )
    assert parent.stdout is not None
    process = os.pidfd_open(int(parent.stdout.readline()))
    parent.kill()
    parent.wait()
    parent.stdout.close()
    assert ends(process)


def test_the_folder_of_a_killed_parent_is_removed_by_the_next_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    dead, alive = (
        tmp_path / f"{child._SCRATCH}{child._pid_namespace()}-{pid}-x"
        for pid in (2**22 + 1, os.getpid())
    )
    dead.mkdir()
    alive.mkdir()
    run("echo")
    assert not dead.exists()
    assert alive.exists()
