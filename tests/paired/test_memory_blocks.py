"""How much memory a process takes up at its peak."""

from multiprocessing.connection import Connection
from pathlib import Path
from typing import cast

import mujoco
import pytest

from mjbench.host import machine
from mjbench.paired import memory_blocks
from mjbench.paired.worker import Worker
from mjbench.simulation import models, workload
from mjbench.simulation.workload import Workload


@pytest.fixture
def cartpoles() -> Workload:
    return workload.make(models.load(models.resolve("cartpole")), nbatch=2, nstep=12, hold=3)


def test_a_workload_is_done_once(cartpoles: Workload, monkeypatch: pytest.MonkeyPatch) -> None:
    taken: list[int] = []
    monkeypatch.setattr(mujoco, "mj_step", lambda model, data, nstep: taken.append(nstep))
    memory_blocks._stepping(cartpoles)()
    assert taken == [3] * 8


def test_a_block_reads_the_peak_after_the_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    done: list[str] = []
    monkeypatch.setattr(machine, "peak_memory_bytes", lambda: 5_000_000 * len(done))
    section = memory_blocks.peak_section(lambda: done.append("steps"))
    section.run()
    assert (section.reading(), done) == (5_000_000, ["steps"])


def test_a_peak_is_prepared_from_the_file_of_a_model(
    cartpoles: Workload, monkeypatch: pytest.MonkeyPatch
) -> None:
    worker, loaded = Worker(cast(Connection, None)), list[Path]()
    worker.workload = cartpoles
    monkeypatch.setattr(worker, "load_model", lambda name, file, options: loaded.append(file))
    monkeypatch.setattr(worker, "read_workload", lambda file: loaded.append(file))
    assert memory_blocks.prepare_peak(worker, Path("robot.xml"), {}, Path("workload")) > 0
    assert loaded == [Path("robot.xml"), Path("workload")]
    assert len(worker.sections) == 1
