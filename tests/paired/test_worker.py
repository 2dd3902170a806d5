"""What one worker does: what it imports, what it sets, and what it refuses."""

import importlib
from multiprocessing.connection import Connection
from pathlib import Path
from typing import cast

import mujoco
import pytest
from commands import python
from paired_examples import INSTALLED

from mjbench.errors import MachineError
from mjbench.host.child_connection import ChildError
from mjbench.paired.worker import Worker
from mjbench.paired.worker_pool import WorkerPool
from mjbench.simulation import models, reference_run, workload
from mjbench.simulation.engine_clock import engine_clock, has_clock
from mjbench.status import Status


def test_a_worker_imports_neither_mujoco_nor_numpy_before_it_has_mapped_other_memory() -> None:
    code = (
        "import sys, mjbench.paired.worker; print({'mujoco', 'numpy', 'msgspec'} & {*sys.modules})"
    )
    assert python("-c", code).stdout.strip() == "set()"


def test_a_task_whose_module_is_missing_in_the_release_is_a_failure_that_names_it(
    pool: WorkerPool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    code = (
        "from mjbench.paired.worker import activity\n@activity('racing')\ndef race(worker): pass\n"
    )
    (tmp_path / "of_the_parent.py").write_text(code)
    monkeypatch.syspath_prepend(tmp_path)
    task = importlib.import_module("of_the_parent").race
    process = pool.start(INSTALLED)
    process.wait()
    with pytest.raises(ChildError) as raised:
        process.call(task)
    pool.end([process])
    assert str(raised.value).endswith(": ModuleNotFoundError: No module named 'of_the_parent'")
    assert raised.value.ending == Status.FAILED


def test_a_run_can_be_prepared_without_the_timer_of_the_python_package() -> None:
    worker = Worker(cast(Connection, None))
    worker.model = models.load(models.resolve("cartpole"))
    if not has_clock(worker.model):
        pytest.skip("this release of MuJoCo installs no timer")
    worker.workload = workload.make(worker.model, nbatch=1, nstep=3)
    worker.final_state = reference_run.observe(worker.workload).final_state
    try:
        worker.prepare_run("python_loop", {}, cores=(), simulations=(0,))
        assert has_clock(worker.model)
        worker.prepare_run("python_loop", {}, cores=(), simulations=(0,), has_timer=False)
        assert not has_clock(worker.model)
    finally:
        engine_clock(True)


def test_a_model_that_a_full_disk_cuts_short_is_an_error_of_the_machine(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    worker = Worker(cast(Connection, None))
    worker.model = models.load(models.resolve("cartpole"))
    file = tmp_path / "model.mjb"
    worker.save_model(file)
    assert models.load(models.ModelSource("cartpole", file)).nq == worker.model.nq
    monkeypatch.setattr(mujoco, "mj_saveModel", lambda model, name, buffer: None)
    file.write_bytes(file.read_bytes()[:-1])
    with pytest.raises(MachineError, match="is the disk full"):
        worker.save_model(file)
