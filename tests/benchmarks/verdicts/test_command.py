"""`python -m benchmarks.verdicts`: its arms, its run file, and Ctrl-C."""

import importlib
import json
import signal
import threading
from pathlib import Path

import process_tree
import pytest
from click.testing import CliRunner, Result
from commands import started

from benchmarks.history.speed_series import NO_CHANGE_PAIRS
from benchmarks.verdicts import trials
from benchmarks.verdicts.records import Arm, CaseRow, TrialRecord
from benchmarks.verdicts.trials import Case
from mjbench.paired.outcomes import Verdict
from mjbench.paired.verdict import VerdictPlan
from mjbench.paired.worker_pool import WorkerPool
from mjbench.simulation import models


def run(
    monkeypatch: pytest.MonkeyPatch, *words: str, most: int = 1000
) -> tuple[list[CaseRow], int, str]:
    """Return what was tried, with verdicts that are invented, the exit code and what was printed.

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

    monkeypatch.setattr(trials, "trial", trial)
    done = invoke(*words)
    return tried, done.exit_code, done.output


def invoke(*words: str) -> Result:
    command = importlib.import_module("benchmarks.verdicts.__main__").verdicts
    return CliRunner().invoke(command, ["--trials", "1", *words])


pytestmark = pytest.mark.usefixtures("quiet_host")


@pytest.fixture(autouse=True)
def in_its_own_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)


def test_without_options_slowdowns_of_two_models_are_injected(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    tried, *_ = run(monkeypatch)
    assert {case.arm for case in tried} == {Arm.SLOWDOWN}
    assert [(case.model, case.slowdown) for case in tried] == [
        (model, slowdown)
        for model in ("cartpole", "humanoid")
        for slowdown in (0.0, 0.005, 0.01, 0.02, 0.05)
    ]


def test_builds_are_compared_on_all_shipped_models_and_a_difference_is_no_failure(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    tried, exit_code, output = run(monkeypatch, "--between-builds")
    assert {case.arm for case in tried} == {Arm.BETWEEN_BUILDS}
    assert [(case.model, case.old, case.new) for case in tried] == [
        (model, pair.old, pair.new) for model in models.shipped() for pair in NO_CHANGE_PAIRS
    ]
    assert exit_code == 0
    assert f"{len(tried)} of {len(tried)} verdicts on known truths are wrong" in output


def test_all_arms_can_be_asked_for_and_are_continued_where_they_ended(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    words = ["pile", "--slowdown", "1", "--between-builds"]
    words += ["--inside-step", "mj_factorM", "--inside-step", "mj_energyPos"]
    first, exit_code, _ = run(monkeypatch, *words, most=3)
    assert exit_code == 130
    assert [(case.arm, case.slowdown, case.callback) for case in first] == [
        (Arm.SLOWDOWN, 0.01, ""),
        (Arm.INSIDE_STEP, None, "mj_factorM"),
        (Arm.INSIDE_STEP, None, "mj_energyPos"),
    ]
    (file,) = Path("results/verdicts").glob("*.jsonl")
    rest, exit_code, _ = run(monkeypatch, *words, "--resume", str(file))
    assert exit_code == 0
    assert [case.arm for case in rest] == [Arm.BETWEEN_BUILDS] * len(NO_CHANGE_PAIRS)
    assert {case.model for case in rest} == {"pile"}


@pytest.mark.parametrize("words", [("--inside-step", "mj_Euler"), ("--slowdown", "-0.3")])
def test_what_cannot_be_tried_is_bad_input(
    monkeypatch: pytest.MonkeyPatch, words: tuple[str, str]
) -> None:
    tried, exit_code, _ = run(monkeypatch, *words)
    assert (tried, exit_code) == ([], 2)


def test_trials_are_measured_and_stored() -> None:
    words = ("cartpole", "--slowdown", "0", "--slowdown", "5", "--budget", "0.2s")
    done = invoke(*words)
    assert done.exit_code == 0, done.output
    assert "verdicts on known truths are wrong" in done.output
    (file,) = Path("results/verdicts").glob("*.jsonl")
    header, *stored = map(json.loads, file.read_text().splitlines())
    assert (header["arguments"]["trials"], header["arguments"]["busy"]) == (1, False)
    assert [(trial["type"], trial["slowdown"]) for trial in stored] == [
        ("trial", 0.0),
        ("trial", 0.05),
    ]


def test_ctrl_c_saves_what_was_measured_and_leaves_no_process() -> None:
    before = process_tree.descendants()
    words = ["-m", "benchmarks.verdicts", "cartpole", "--slowdown", "0"]
    with started(*words, cwd=Path.cwd(), stdout=None) as process:
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
