"""`asv run`, in a new environment of its own: discovery, then one short benchmark.

Its packages are those of asv.conf.json, without MJX and JAX, which need not be there.
"""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import mujoco
import pytest
from asv import util
from commands import ROOT
from index_access import index_has_mujoco

from benchmarks.studies.slowdown import MACHINE

BENCHMARK, MODEL = "step.Step.time_1000_steps", "cartpole"


def _run_asv(folder: Path, *arguments: str) -> None:
    """Run asv with `folder` as its home; pip keeps its cache, and compiles nothing unasked."""
    cache = os.environ.get("PIP_CACHE_DIR") or str(Path.home() / ".cache/pip")
    pip = {"PIP_CACHE_DIR": cache, "PIP_NO_COMPILE": "1"}
    completed = subprocess.run(
        [sys.executable, "-m", "asv", "run", *arguments],
        cwd=folder,
        env={**os.environ, "HOME": str(folder), **pip},
        capture_output=True,
        text=True,
        check=False,
    )
    output = completed.stdout + completed.stderr
    assert completed.returncode == 0, output
    assert "failed" not in output, output


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Write the configuration of this checkout, with folders of its own, and a machine."""
    configuration = util.load_json(str(ROOT / "asv.conf.json"), js_comments=True)
    install, *optional = configuration["install_command"]
    assert all("return-code=any" in command for command in optional)
    configuration |= {
        "repo": str(ROOT / configuration["repo"]),
        "benchmark_dir": str(ROOT / configuration["benchmark_dir"]),
        "env_dir": str(tmp_path / "env"),
        "results_dir": str(tmp_path / "results"),
        "install_command": [install],
    }
    (tmp_path / "asv.conf.json").write_text(json.dumps(configuration))
    machine = {"version": 1, MACHINE["machine"]: MACHINE}
    (tmp_path / ".asv-machine.json").write_text(json.dumps(machine))
    return tmp_path


def test_asv_finds_and_runs_a_benchmark(folder: Path) -> None:
    if not index_has_mujoco():
        pytest.skip("the package index cannot be reached")
    _run_asv(
        folder, f"v{mujoco.__version__}^!", "--quick", "--machine", MACHINE["machine"],
        "--bench", rf"{re.escape(BENCHMARK)}\(.{MODEL}.\)",
    )  # fmt: skip
    packages = folder.glob("env/*/lib/python*/site-packages/*.dist-info")
    installed = {package.name.partition("-")[0].lower() for package in packages}
    assert {"numpy", "mujoco"} <= installed
    assert not installed & {"pytest", "click", "msgspec", "psutil", "rich", "scipy"}
    (file,) = folder.glob(f"results/{MACHINE['machine']}/*-virtualenv-*.json")
    times_s = json.loads(file.read_text())["results"][BENCHMARK][0]
    assert sum(time_s is not None and time_s > 0 for time_s in times_s) == 1
