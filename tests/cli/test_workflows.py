"""The workflows: what they run exists, and the action does what it says."""

import os
import re
import subprocess
from pathlib import Path
from typing import Any

import pytest
import yaml
from commands import ROOT, Completed, mjbench
from paired_examples import decided
from set_files import labelled, run_file
from verdict_records import SLOWER

from mjbench import extras
from mjbench.paired import verdict

WORKFLOWS = sorted((ROOT / ".github/workflows").glob("*.yml"))
EXAMPLES = ROOT / "docs/examples"
ACTION = ROOT / ".github/actions/mjbench/action.yml"


def steps(file: Path) -> list[dict[str, Any]]:
    content = yaml.safe_load(file.read_text())
    if "runs" in content:
        return list(content["runs"]["steps"])
    return [step for job in content["jobs"].values() for step in job["steps"]]


def lines(file: Path) -> list[str]:
    """Return the lines that the steps of a workflow run."""
    return [line for step in steps(file) if "run" in step for line in step["run"].splitlines()]


@pytest.mark.parametrize("file", WORKFLOWS, ids=lambda f: f.stem)
def test_a_workflow_runs_what_a_person_runs(file: Path) -> None:
    makefile = (ROOT / "Makefile").read_text()
    assert lines(file)
    for line in lines(file):
        for target in re.findall(r"\bmake (\S+)", line):
            assert re.search(rf"^{target}:", makefile, flags=re.M), target
        for script in re.findall(r"(?<![\w/])\.ci/\S+", line):
            assert os.access(ROOT / script, os.X_OK), script
    assert all(re.search(r"@v\d", step["uses"]) for step in steps(file) if "uses" in step)


class Recorder:
    """A program in place of mjbench that notes how a shell calls it, and prints a mark."""

    def __init__(self, file: Path):
        self._calls = file.with_name("calls")
        file.parent.mkdir(parents=True)
        words = 'printf "%s\\0" "$@"'
        file.write_text(f"#!/bin/bash\n{{ {words}; echo; }} >> {self._calls}\necho MARK\n")
        file.chmod(0o755)

    def run(self, lines: str, cwd: Path, **variables: str) -> Completed:
        """Run lines of a shell, and then in this process what they call; return how it ended."""
        self._calls.unlink(missing_ok=True)
        command = ["bash", "-eo", "pipefail", "-c", lines]
        subprocess.run(command, cwd=cwd, env=os.environ | variables, check=True)
        for call in self._calls.read_text().splitlines():
            done = mjbench(*call.split("\0")[:-1], cwd=cwd)
            assert done.returncode == 0, done.stderr
        return done


needs_reports = pytest.mark.skipif(
    bool(extras.missing(["jinja2", "vl_convert"])), reason="needs jinja2 and vl_convert"
)


@needs_reports
def test_the_action_compares_releases_and_writes_a_report(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its steps run as they are, but for the first, which installs mjbench."""
    monkeypatch.setattr(verdict, "decide_pair", lambda pool, *targets: decided(*targets[:2]))
    install, compare, report = steps(ACTION)
    assert "pip" in install["run"]
    recorder = Recorder(tmp_path / "mjbench/bin/mjbench")
    env = {
        "RUNNER_TEMP": str(tmp_path),
        "GITHUB_STEP_SUMMARY": str(tmp_path / "summary.md"),
        "GITHUB_OUTPUT": str(tmp_path / "output"),
    }
    inputs = {
        "OLD": "installed",
        "NEW": "installed",
        "MODELS": "cartpole pile",
        "FAIL_ON": "slower",
        "ARGUMENTS": "--allow-inconclusive --budget 0.2s",
    }
    assert set(inputs) == set(compare["env"])
    compared = recorder.run(compare["run"], tmp_path, **env, **inputs)
    assert all(f"\n{model}, " in compared.stdout for model in ("cartpole", "pile"))
    summary = recorder.run(report["run"], tmp_path, **env)
    assert summary.stdout.startswith("## mjbench versions")
    assert (tmp_path / "summary.md").read_text() == "MARK\n"
    assert (tmp_path / "output").read_text() == f"file={tmp_path}/mjbench.html\n"
    assert (tmp_path / "mjbench.html").read_text().startswith("<!doctype html>")


@needs_reports
def test_the_workflow_for_several_machines_shows_what_its_jobs_upload(tmp_path: Path) -> None:
    jobs = yaml.safe_load((EXAMPLES / "machines.yml").read_text())["jobs"]
    for runner in jobs["measure"]["strategy"]["matrix"]["runner"]:
        run_file(tmp_path / f"runs-{runner}", labelled(runner), SLOWER, command="versions")
    recorder = Recorder(tmp_path / "bin/mjbench")
    env = {
        "PATH": f"{tmp_path / 'bin'}{os.pathsep}{os.environ['PATH']}",
        "GITHUB_STEP_SUMMARY": str(tmp_path / "summary.md"),
    }
    lines = [step["run"] for step in jobs["report"]["steps"] if "run" in step]
    shown = [recorder.run(line, tmp_path, **env) for line in lines if line.startswith("mjbench ")]
    assert "slower on all 4 machines" in shown[0].stdout
    assert (tmp_path / "summary.md").read_text() == "MARK\n"
    uploaded = jobs["report"]["steps"][-1]["with"]["path"].split()
    assert all([*tmp_path.glob(name)] for name in uploaded)


def test_the_workflows_of_a_change_read_and_comment_apart() -> None:
    """The job that runs the code of a pull request may write nothing."""
    files = (EXAMPLES / "speed.yml", EXAMPLES / "speed-comment.yml")
    measure, comment = (yaml.safe_load(file.read_text()) for file in files)
    assert measure["permissions"] == {"contents": "read"}
    assert comment["permissions"]["pull-requests"] == "write"
    assert comment[True]["workflow_run"]["workflows"] == [measure["name"]]  # YAML reads on as true
    (job,) = comment["jobs"].values()
    assert not any("checkout" in step.get("uses", "") for step in job["steps"])
    (line,) = [step["run"] for step in job["steps"] if "run" in step]
    subprocess.run(["bash", "-n", "-c", line], check=True)
