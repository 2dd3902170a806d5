"""What one worker does: what it imports, what it sets, and what it refuses."""

import subprocess
import sys
from dataclasses import replace
from multiprocessing.connection import Connection
from pathlib import Path
from typing import cast

import mujoco
import pytest
from commands import ROOT
from paired_examples import CUBES

from mjbench.errors import MachineError
from mjbench.paired import requests
from mjbench.paired.protocol import TargetPair
from mjbench.paired.worker import Worker
from mjbench.paired.worker_pool import TargetError, WorkerPool
from mjbench.simulation import models


def test_a_worker_imports_neither_mujoco_nor_numpy_before_it_has_mapped_other_memory() -> None:
    code = (
        "import sys, mjbench.paired.worker; print({'mujoco', 'numpy', 'msgspec'} & {*sys.modules})"
    )
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"


def test_a_path_that_computes_something_else_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    target = replace(CUBES, path="wrong_paths:ColdWarmStart")
    monkeypatch.setenv("PYTHONPATH", str(ROOT / "tests"))
    with WorkerPool(limit_s=30.0) as pool:
        pair = TargetPair(pool, target, target)
        with pytest.raises(TargetError, match="does not reach the final states"):
            pair.launch()


def test_a_model_that_a_full_disk_cuts_short_is_an_error_of_the_machine(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    worker = Worker(cast(Connection, None))
    worker.model = models.load(models.resolve("cartpole"))
    file = tmp_path / "model.mjb"
    worker._save_model(requests.SaveModel(file))
    assert models.load(models.ModelSource("cartpole", file)).nq == worker.model.nq
    monkeypatch.setattr(mujoco, "mj_saveModel", lambda model, name, buffer: None)
    file.write_bytes(file.read_bytes()[:-1])
    with pytest.raises(MachineError, match="is the disk full"):
        worker._save_model(requests.SaveModel(file))
