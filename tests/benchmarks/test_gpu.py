"""The command for a GPU says so where there is none."""

import stat
from pathlib import Path

import pytest

from benchmarks import gpu
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
