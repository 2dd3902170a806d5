"""How much memory steps add, and what a process takes up."""

import math
from multiprocessing.connection import Connection
from typing import cast

import mujoco
import numpy as np
import pytest

from mjbench.paired import memory_blocks
from mjbench.paired.judgement import judge
from mjbench.paired.memory_blocks import growth_section
from mjbench.paired.metrics import GROWTH_UNIT_BYTES
from mjbench.paired.outcomes import Verdict
from mjbench.paired.worker import Worker
from mjbench.simulation import models, workload

MB = 1_000_000


class Process:
    """A process whose steps add memory."""

    def __init__(self, bytes_per_step: float):
        self.resident, self._bytes_per_step = 80 * MB, bytes_per_step

    def block(self, nstep: int) -> int:
        """Return the reading of a block of steps."""

        def step() -> None:
            self.resident += round(self._bytes_per_step * nstep)

        section = growth_section(step, nstep, lambda: self.resident)
        section.warm_up()
        section.run()
        assert section.reading is not None
        return section.reading()


def test_a_block_reads_what_a_thousand_steps_add_whatever_its_length() -> None:
    for nstep in (100, 1000, 5000):
        assert Process(0.0).block(nstep) == GROWTH_UNIT_BYTES
        assert Process(1000.0).block(nstep) == GROWTH_UNIT_BYTES + MB


def test_memory_that_is_given_back_is_no_growth() -> None:
    assert Process(-5000.0).block(1000) == GROWTH_UNIT_BYTES


def verdict(baseline: float, candidate: float, noise: float = 0.002) -> Verdict:
    """Return the verdict on two processes that add so many bytes a step, with a little noise."""
    rng = np.random.default_rng(0)
    ratio = math.log(Process(candidate).block(5000) / Process(baseline).block(5000))
    return judge(ratio + rng.normal(0.0, noise, 20), 0.01, 0.99, 0.005).verdict


def test_a_leak_of_a_megabyte_in_a_thousand_steps_is_found_and_none_is_invented() -> None:
    assert verdict(0.0, 1000.0) == Verdict.SLOWER
    assert verdict(1000.0, 0.0) == Verdict.FASTER
    assert verdict(0.0, 0.0) == Verdict.SAME
    assert verdict(1000.0, 1000.0) == Verdict.SAME


@pytest.mark.parametrize("noise", [0.0, 0.002])
def test_processes_without_any_noise_are_judged_too(noise: float) -> None:
    assert verdict(0.0, 0.0, noise) == Verdict.SAME
    assert verdict(0.0, 1000.0, noise) == Verdict.SLOWER


@pytest.mark.parametrize("nstep", [1, 12, 13, 250])
def test_a_block_takes_as_many_steps_as_asked_for(
    nstep: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    repeated = workload.make(models.load(models.resolve("cartpole")), nbatch=2, nstep=50)
    taken: list[int] = []
    monkeypatch.setattr(mujoco, "mj_step", lambda model, data, nstep: taken.append(nstep))
    memory_blocks._stepping(repeated, nstep)()
    assert sum(taken) == nstep


def test_memory_that_this_process_takes_is_seen() -> None:
    before = memory_blocks.resident_bytes()
    taken = np.ones(20 * MB // 8)
    assert memory_blocks.resident_bytes() - before > 0.9 * taken.nbytes


def test_steps_of_a_model_add_next_to_nothing() -> None:
    worker = Worker(cast(Connection, None))
    worker.model = models.load(models.resolve("cartpole"))
    worker.workload = workload.make(worker.model, nbatch=1, nstep=10)
    assert memory_blocks.prepare_growth(worker, 1000) > 0
    (section,) = worker.sections
    section.warm_up()
    section.run()
    assert section.reading is not None
    assert abs(section.reading() - GROWTH_UNIT_BYTES) < 0.5 * MB
