"""What one worker does: what it imports, what it sets, and what it refuses."""

import subprocess
import sys
from dataclasses import replace

import pytest
from commands import ROOT
from paired_examples import CUBES

from mjbench.paired.protocol import TargetPair
from mjbench.paired.worker_pool import TargetError, WorkerPool


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
