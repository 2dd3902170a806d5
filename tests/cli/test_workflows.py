"""The workflows: what they run exists, and the action does what it says."""

import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml
from commands import PYTHONPATH, ROOT
from set_files import labelled, run_file
from verdict_records import SLOWER

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


def test_the_action_compares_releases_and_writes_a_report(tmp_path: Path, cube_table: Path) -> None:
    """Its steps run as they are, but for the first, which installs mjbench."""
    install, compare, report = steps(ACTION)
    assert "pip" in install["run"]
    binary = tmp_path / "mjbench/bin/mjbench"
    binary.parent.mkdir(parents=True)
    binary.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m mjbench "$@"\n')
    binary.chmod(0o755)
    env = {
        **os.environ,
        "PYTHONPATH": PYTHONPATH,
        "RUNNER_TEMP": str(tmp_path),
        "GITHUB_STEP_SUMMARY": str(tmp_path / "summary.md"),
        "GITHUB_OUTPUT": str(tmp_path / "output"),
    }
    inputs = {
        "OLD": "installed",
        "NEW": "installed",
        "MODELS": str(cube_table),
        "FAIL_ON": "changed-work",
        "ARGUMENTS": "--allow-inconclusive --time-limit 0.2s",
    }
    assert set(inputs) == set(compare["env"])
    for step in (compare, report):
        subprocess.run(["bash", "-eo", "pipefail", "-c", step["run"]], env=env | inputs, check=True)
    assert (tmp_path / "summary.md").read_text().startswith("## mjbench versions")
    assert (tmp_path / "output").read_text() == f"file={tmp_path}/mjbench.html\n"
    assert (tmp_path / "mjbench.html").read_text().startswith("<!doctype html>")


@pytest.fixture
def cube_table() -> Path:
    pytest.importorskip("jinja2")
    pytest.importorskip("vl_convert")
    return ROOT / "models/cube_table.xml"


def test_the_workflow_for_several_machines_merges_what_its_jobs_upload(tmp_path: Path) -> None:
    pytest.importorskip("jinja2")
    pytest.importorskip("vl_convert")
    jobs = yaml.safe_load((EXAMPLES / "machines.yml").read_text())["jobs"]
    for runner in jobs["measure"]["strategy"]["matrix"]["runner"]:
        run_file(tmp_path / f"runs-{runner}", labelled(runner), SLOWER, command="versions")
    binary = tmp_path / "bin/mjbench"
    binary.parent.mkdir()
    binary.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m mjbench "$@"\n')
    binary.chmod(0o755)
    env = {
        **os.environ,
        "PYTHONPATH": PYTHONPATH,
        "PATH": f"{binary.parent}{os.pathsep}{os.environ['PATH']}",
        "GITHUB_STEP_SUMMARY": str(tmp_path / "summary.md"),
    }
    lines = [step["run"] for step in jobs["report"]["steps"] if "run" in step]
    for line in lines:
        if line.startswith("mjbench "):
            subprocess.run(["bash", "-ec", line], cwd=tmp_path, env=env, check=True)
    assert "slower on all 4 machines" in (tmp_path / "summary.md").read_text()
    uploaded = jobs["report"]["steps"][-1]["with"]["path"].split()
    assert all((tmp_path / name).is_file() for name in uploaded)


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
