"""`mjbench selfcheck`: its rows, its run file, and Ctrl-C."""

import json
import os
import select
import signal
import subprocess
import sys
import time
from pathlib import Path

import process_tree
import pytest
from commands import PYTHONPATH, mjbench


def test_selfcheck_reports_a_row_for_each_model_and_slowdown(tmp_path: Path) -> None:
    done = mjbench(
        *("selfcheck", "cartpole", "--trials", "1", "--slowdowns", "0,5", "--time-limit", "0.2s"),
        *("--json", "out.json"),
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stderr
    rows = json.loads((tmp_path / "out.json").read_text())["results"]
    assert [(r["model"], r["slowdown"], r["trials"]) for r in rows] == [
        ("cartpole", 0.0, 1),
        ("cartpole", 0.05, 1),
    ]
    (file,) = (tmp_path / "results/runs").glob("*.jsonl")
    header, *trials = map(json.loads, file.read_text().splitlines())
    assert (header["arguments"]["trials"], header["arguments"]["busy"]) == (1, False)
    assert [trial["type"] for trial in trials] == ["trial"] * 2
    again = mjbench("show", "--json", "again.json", cwd=tmp_path)
    assert again.returncode == 0
    assert json.loads((tmp_path / "again.json").read_text())["results"] == rows


@pytest.mark.parametrize(
    ("slowdowns", "message"),
    [("0.3", "must be a whole number"), ("0,tea", "not a list of percentages")],
)
def test_a_slowdown_that_cannot_be_injected_is_bad_input(
    tmp_path: Path, slowdowns: str, message: str
) -> None:
    done = mjbench("selfcheck", "--slowdowns", slowdowns, cwd=tmp_path)
    assert done.returncode == 2
    assert message in done.stderr


def test_ctrl_c_saves_what_was_measured_and_leaves_no_process(tmp_path: Path) -> None:
    before = process_tree.descendants()
    process = subprocess.Popen(
        [sys.executable, "-m", "mjbench", "selfcheck", "cartpole", "--slowdowns", "0"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": PYTHONPATH},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    deadline = time.monotonic() + 60
    while len(process_tree.descendants() - before) < 4 and time.monotonic() < deadline:
        os.sched_yield()
    workers = process_tree.descendants() - before - {process.pid}
    descriptors = [os.pidfd_open(pid) for pid in workers]
    assert len(descriptors) >= 2
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "interrupted" in errors
    assert "Traceback" not in errors
    for descriptor in descriptors:
        ended, _, _ = select.select([descriptor], [], [], 60.0)  # long only where the test fails
        assert ended
        os.close(descriptor)
