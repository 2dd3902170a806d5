"""The command for a GPU: what it measures, what fails, and where there is none."""

import gc
import json
import stat
import subprocess
import sys
import weakref
from pathlib import Path
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pytest

from benchmarks import stored
from benchmarks.studies import gpu, tally_file
from benchmarks.studies.testspeed import NOISE, NOISE_S, noisy_keyframe
from mjbench.errors import MachineError
from mjbench.simulation.workload import fields
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
        output = f"Warp 1.19\n{json.dumps(metrics)}\n{json.dumps({'steps_s': [0.001, 0.0002]})}\n"
        return subprocess.CompletedProcess(command, 0, output, "")

    monkeypatch.setattr(subprocess, "run", run)
    speed = gpu.testspeed("cartpole", 1024)
    assert (speed.nworld, speed.ns_per_step, speed.compile_s) == (1024, 200.0, 100.0)
    assert speed.steps_ns == pytest.approx((1e6 / 1024, 2e5 / 1024))
    assert {"--nworld=1024", "--nconmax=48", "--njmax=1"} <= set(commands[0])


def test_testspeed_that_fails_is_a_line(monkeypatch: pytest.MonkeyPatch) -> None:
    failed = subprocess.CompletedProcess([], 1, "", "Traceback\nRuntimeError: no device\n")
    monkeypatch.setattr(subprocess, "run", lambda *_, **__: failed)
    with pytest.raises(MachineError, match="on cartpole failed: RuntimeError: no device"):
        gpu.testspeed("cartpole", 1)


def test_testspeed_starts_at_keyframe_0_and_its_controls_have_noise_of_a_halton_sequence() -> None:
    workload = noisy_keyframe("humanoid", 4, 2)
    model = workload.model
    qpos = fields(model, workload.initial_state)["qpos"]
    assert np.array_equal(qpos, np.tile(model.key_qpos[0], (4, 1)))
    correlation = np.exp(-model.opt.timestep / NOISE_S)
    scale = NOISE * np.sqrt(1 - correlation**2) * np.ptp(model.actuator_ctrlrange[0]) / 2
    # in base 2: 1/2, 1/4, 3/4, 1/8; in the second step 1/4, 1/8, 3/8, 1/16
    first = scale * np.array([0.0, -0.5, 0.5, -0.75])
    second = correlation * first + scale * np.array([-0.5, -0.75, -0.25, -0.875])
    assert workload.control[:, :, 0] == pytest.approx(np.transpose([first, second]))


def test_the_model_of_a_captured_graph_lives_as_long_as_the_program(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Without it, the graph would read arrays that were freed."""
    models = [MagicMock()]
    alive = weakref.ref(models[0])
    engine = MagicMock(put_model=lambda _: models.pop())
    monkeypatch.setitem(sys.modules, "mujoco_warp", engine)
    monkeypatch.setitem(sys.modules, "warp", MagicMock())
    run = gpu._handwritten_warp(stored.stored_workload("cartpole", 2, 2), {})
    engine.reset_mock()  # it recorded its calls' arguments
    gc.collect()
    assert alive() is not None
    del run
    gc.collect()
    assert alive() is None


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
    assert tally.failures == ("no memory", "no memory")
    assert tally_file.load(tmp_path / "gpu.json", gpu.GpuTally, "a GPU") == tally
