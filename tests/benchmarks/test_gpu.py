"""The command for a GPU: what it measures, what fails, and where there is none."""

import json
import stat
import subprocess
from pathlib import Path
from typing import Any

import pytest

from benchmarks import gpu
from benchmarks.studies import tally_file
from mjbench.errors import MachineError
from mjbench.status import ExitCode


def test_without_a_gpu_nothing_is_measured(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    assert gpu.main([]) == ExitCode.ENVIRONMENT
    assert "there is no GPU here" in capsys.readouterr().err


def test_each_gpu_is_a_line(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    command = tmp_path / "nvidia-smi"
    command.write_text("#!/bin/sh\necho 'H100, 1, 2'\necho 'H100, 3, 4'\n")
    command.chmod(command.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("PATH", str(tmp_path))
    assert gpu.gpus() == ("H100, 1, 2", "H100, 3, 4")


def test_testspeed_runs_with_the_buffers_of_the_path(monkeypatch: pytest.MonkeyPatch) -> None:
    commands = []

    def run(command: list[str], **options: Any) -> subprocess.CompletedProcess[str]:
        commands.append(command)
        metrics = {
            "steps_per_second": 5e6,
            "jit_duration": 100.0,
            "ncon_mean": 8.0,
            "nefc_mean": 33.9,
            "solver_niter_mean": 1.1,
        }
        return subprocess.CompletedProcess(command, 0, f"Warp 1.19\n{json.dumps(metrics)}\n", "")

    monkeypatch.setattr(subprocess, "run", run)
    speed = gpu.testspeed("cartpole", 1024)
    assert (speed.nworld, speed.ns_per_step, speed.compile_s) == (1024, 200.0, 100.0)
    assert {"--nworld=1024", "--nconmax=48", "--njmax=1"} <= set(commands[0])


def test_testspeed_that_fails_is_a_line(monkeypatch: pytest.MonkeyPatch) -> None:
    failed = subprocess.CompletedProcess([], 1, "", "Traceback\nRuntimeError: no device\n")
    monkeypatch.setattr(subprocess, "run", lambda *_, **__: failed)
    with pytest.raises(MachineError, match="on cartpole failed: RuntimeError: no device"):
        gpu.testspeed("cartpole", 1)


def test_a_figure_that_fails_costs_no_other(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def fail(*arguments: object) -> None:
        raise MachineError("no memory")

    speed = gpu.Testspeed("cartpole", 8, 1.0, 2.0, 3.0, 4.0, 5.0)
    monkeypatch.setattr(gpu, "gpus", lambda: ("H100",))
    monkeypatch.setattr(gpu, "compare", lambda *_: None)
    monkeypatch.setattr(gpu, "testspeed", lambda *_: speed)
    monkeypatch.setattr(gpu, "warp_over_by_hand", fail)
    ratio = gpu.OverByHand("mjx", "cartpole", 1024, 1.0)
    monkeypatch.setattr(gpu, "mjx_over_by_hand", lambda: ratio)
    tally = gpu.run(["cartpole"], "8", gpu.PATHS, tmp_path)
    assert tally.testspeed == (speed,)
    assert tally.over_by_hand == (ratio,)
    assert tally.failures == ("no memory",)
    assert tally_file.load(tmp_path / "gpu.json", gpu.GpuTally, "a GPU") == tally
