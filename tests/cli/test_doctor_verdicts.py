"""`mjbench doctor --verdicts`: its arms, its rows, its run file, and Ctrl-C."""

import json
import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import process_tree
import pytest
from click.testing import CliRunner
from commands import PYTHONPATH, mjbench

from mjbench.cli import cli
from mjbench.paired import selfcheck
from mjbench.paired.outcomes import Arm, Verdict
from mjbench.paired.selfcheck import Case
from mjbench.paired.selfcheck_records import CaseRow, TrialRecord
from mjbench.paired.verdict import VerdictPlan
from mjbench.paired.worker_pool import WorkerPool
from mjbench.releases.release import NO_CHANGE_PAIRS
from mjbench.simulation import models


def run_selfcheck(
    monkeypatch: pytest.MonkeyPatch, *words: str, most: int = 1000
) -> tuple[list[CaseRow], int]:
    """Return what was tried, with verdicts that are invented, and the exit code.

    Args:
      monkeypatch: of the test.
      words: of the command.
      most: trials before it is interrupted.
    """
    tried: list[CaseRow] = []

    def trial(pool: WorkerPool, case: Case, plan: VerdictPlan) -> TrialRecord:
        if len(tried) == most:
            raise KeyboardInterrupt
        tried.append(case.row())
        return TrialRecord(
            **vars(case.row()),
            verdict=Verdict.SLOWER,
            estimate=1.02,
            low=1.01,
            high=1.03,
            seconds=1.0,
            launches=[0.02],
        )

    monkeypatch.setattr(selfcheck, "trial", trial)
    done = CliRunner().invoke(cli, ["doctor", "--verdicts", "--trials", "1", *words])
    return tried, done.exit_code


def test_without_options_slowdowns_of_two_models_are_injected(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    tried, _ = run_selfcheck(monkeypatch)
    assert {case.arm for case in tried} == {Arm.SLOWDOWN}
    assert [(case.model, case.slowdown) for case in tried] == [
        (model, slowdown)
        for model in ("cartpole", "humanoid")
        for slowdown in (0.0, 0.005, 0.01, 0.02, 0.05)
    ]


def test_builds_are_compared_on_all_shipped_models_and_a_difference_is_no_failure(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    tried, exit_code = run_selfcheck(monkeypatch, "--between-builds", "--json", "out.json")
    assert {case.arm for case in tried} == {Arm.BETWEEN_BUILDS}
    assert [(case.model, case.old, case.new) for case in tried] == [
        (model, pair.old, pair.new) for model in models.shipped() for pair in NO_CHANGE_PAIRS
    ]
    assert exit_code == 0
    rows = json.loads(Path("out.json").read_text())["results"]
    assert [row["wrong"] for row in rows] == [1.0] * len(tried)


def test_all_arms_can_be_asked_for_and_are_continued_where_they_ended(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    words = ["pile", "--slowdowns", "0", "--between-builds"]
    words += ["--inside-step", "mj_factorM", "--inside-step", "mj_energyPos"]
    first, exit_code = run_selfcheck(monkeypatch, *words, most=3)
    assert exit_code == 130
    assert [(case.arm, case.callback) for case in first] == [
        (Arm.SLOWDOWN, ""),
        (Arm.INSIDE_STEP, "mj_factorM"),
        (Arm.INSIDE_STEP, "mj_energyPos"),
    ]
    (file,) = Path("results/runs").glob("*.jsonl")
    rest, exit_code = run_selfcheck(monkeypatch, *words, "--resume", str(file))
    assert exit_code == 0
    assert [case.arm for case in rest] == [Arm.BETWEEN_BUILDS] * len(NO_CHANGE_PAIRS)
    assert {case.model for case in rest} == {"pile"}


def test_a_function_that_is_not_declared_is_bad_input(monkeypatch: pytest.MonkeyPatch) -> None:
    tried, exit_code = run_selfcheck(monkeypatch, "--inside-step", "mj_Euler")
    assert (tried, exit_code) == ([], 2)


def test_selfcheck_reports_a_row_for_each_model_and_slowdown(tmp_path: Path) -> None:
    done = mjbench(
        *(
            "doctor",
            "--verdicts",
            "cartpole",
            "--trials",
            "1",
            "--slowdowns",
            "0,5",
            "--budget",
            "0.2s",
        ),
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
    [("-0.3", "each from 0% to 1000%"), ("0,tea", "not a list of percentages")],
)
def test_a_slowdown_that_cannot_be_injected_is_bad_input(
    tmp_path: Path, slowdowns: str, message: str
) -> None:
    done = mjbench("doctor", "--verdicts", "--slowdowns", slowdowns, cwd=tmp_path)
    assert done.returncode == 2
    assert message in done.stderr


def test_ctrl_c_saves_what_was_measured_and_leaves_no_process(tmp_path: Path) -> None:
    before = process_tree.descendants()
    with subprocess.Popen(
        [sys.executable, "-m", "mjbench", "doctor", "--verdicts", "cartpole", "--slowdowns", "0"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": PYTHONPATH},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        try:
            while len(process_tree.descendants() - before) < 4 and process.poll() is None:
                threading.Event().wait(0.05)
            workers = process_tree.descendants() - before - {process.pid}
            descriptors = process_tree.opened(workers)
            assert len(descriptors) >= 2
            process.send_signal(signal.SIGINT)
            _, errors = process.communicate(timeout=60)
        finally:
            process.kill()  # where the test fails: what lives on would disturb other tests
    assert process.returncode == 130
    assert "interrupted" in errors
    assert "Traceback" not in errors
    assert all(map(process_tree.ends, descriptors))
