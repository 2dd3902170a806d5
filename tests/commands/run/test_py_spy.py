"""py-spy's file is read, or refused in one line; so is why there are no samples."""

import json
import os
import subprocess
import sys
from types import SimpleNamespace

import pytest
from commands import PYTHONPATH
from process_tree import ends

from mjbench.commands.run import py_spy
from mjbench.commands.run.py_spy import Frame, Thread
from mjbench.errors import InputError

REFUSED = """\
Error: Permission Denied: Try running again with elevated permissions by going 'sudo env …'
Error: Failed to open process 1 - check if it is running.
Reason: Permission denied (os error 13)
"""


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (REFUSED, ["Permission denied", "SYS_PTRACE"]),
        ("Error: Operation not permitted\n", ["SYS_PTRACE", "ptrace_scope"]),
        ("py-spy> Samples: 0 Errors: 0\n", [py_spy.TOO_SHORT]),
        ("Error: /root/x: anyhow\n", [py_spy.TOO_SHORT]),
        ("", [py_spy.TOO_SHORT]),
    ],
)
def test_why_there_are_no_samples(tmp_path, text, words):
    log = tmp_path / "log"
    log.write_text(text)
    problem = py_spy.Sampler(SimpleNamespace(), tmp_path / "samples.json", log).problem()
    assert all(word in problem for word in words)
    assert "\n" not in problem


def test_the_profiler_ends_with_mjbench_however_that_ends(tmp_path):
    profiler = tmp_path / "py-spy"
    profiler.write_text(f"#!/bin/sh\necho $$ > {tmp_path}/pid\nexec sleep 600\n")
    profiler.chmod(0o755)
    os.mkfifo(tmp_path / "pid")
    program = (
        "import os, signal, sys\n"
        "from pathlib import Path\n"
        "from mjbench.commands.run import py_spy\n"
        "py_spy.program = lambda: sys.argv[1] + '/py-spy'\n"
        "py_spy.start(os.getpid(), Path(sys.argv[1]), 10, False)\n"
        "signal.pause()"
    )
    parent = subprocess.Popen(
        [sys.executable, "-c", program, str(tmp_path)], env={**os.environ, "PYTHONPATH": PYTHONPATH}
    )
    process = os.pidfd_open(int((tmp_path / "pid").read_text()))
    parent.kill()
    parent.wait()
    assert ends(process)


def document(name='Process 7 Thread 8 "Main"'):
    return {
        "profiles": [{"name": name, "samples": [[0, 1, 2], [0, 1]], "weights": [0.02, 0.02]}],
        "shared": {
            "frames": [
                {"name": 'process 7:"python x.py"', "file": "", "line": 0},
                {"name": "main", "file": "/x.py", "line": 3},
                {"name": "step", "file": "/y.py", "line": 5},
            ]
        },
    }


def test_stacks_are_read_without_labels(tmp_path):
    file = tmp_path / "samples.json"
    file.write_text(json.dumps(document()))
    (thread,) = py_spy.read(file)
    assert thread.thread == Thread(7, 8, "Main")
    assert thread.interval_s == 0.02
    main, step = Frame("main", "/x.py", 3), Frame("step", "/y.py", 5)
    assert thread.stacks == [[main, step], [main]]


def test_a_name_that_was_read_while_it_changed_holds_no_null_byte(tmp_path):
    stored = document()
    stored["shared"]["frames"][2]["file"] = "/y\0.py"
    file = tmp_path / "samples.json"
    file.write_text(json.dumps(stored))
    (thread,) = py_spy.read(file)
    assert thread.stacks[0][1].file == "/y.py"


@pytest.mark.parametrize(
    "text", ["", "{}", "[]", '{"profiles": 3}', "\0", json.dumps(document("no thread"))]
)
def test_other_files_are_refused(tmp_path, text):
    file = tmp_path / "samples.json"
    file.write_text(text)
    with pytest.raises(InputError, match="profiler"):
        py_spy.read(file)


def test_samples_stand_for_the_time_in_which_they_were_taken():
    stack = [Frame("main", "/x.py", 3)]
    whole = py_spy.ThreadSamples(Thread(1, 1, "a"), [stack] * 4, 0.1, 0.1)
    late = py_spy.ThreadSamples(Thread(1, 2, "b"), [stack], 0.1)
    spread = py_spy.spread_over([whole, late], 2.0)
    assert [each.interval_s for each in spread] == [0.5, 0.5]
    assert spread[0].least_s == 0.1
    assert py_spy.spread_over([], 2.0) == []


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(InputError, match="profiler's samples"):
        py_spy.read(tmp_path / "missing.json")


def test_samples_that_took_no_time_are_none():
    thread = py_spy.ThreadSamples(Thread(1, 1, "Main"), [[]], 0.01)
    assert py_spy.spread_over([thread], 0.0) == []
