"""How much memory steps add, and what a process takes up."""

import gc
import math
import mmap
from multiprocessing.connection import Connection
from typing import cast

import mujoco
import numpy as np
import pytest

from mjbench.errors import UnavailableError
from mjbench.host import machine
from mjbench.paired import memory_blocks
from mjbench.paired.memory_blocks import GROWTH_NSTEP, growth_section
from mjbench.paired.metrics import GROWTH_UNIT_BYTES, Metric
from mjbench.paired.outcomes import Verdict
from mjbench.paired.verdict import judge
from mjbench.paired.worker import Worker
from mjbench.simulation import models, workload

MB = 1_000_000


class Process:
    """A process whose steps add memory, which is counted in pages.

    Args:
      stray_pages: that come and go besides, at most.
    """

    def __init__(self, bytes_per_step: float, stray_pages: int = 0, seed: int = 0):
        self.used, self._bytes_per_step = 80 * MB, bytes_per_step
        self._stray_pages, self._rng = stray_pages, np.random.default_rng(seed)

    def resident_bytes(self) -> int:
        """Return what the system says of it."""
        pages = self.used // mmap.PAGESIZE + int(self._rng.integers(0, self._stray_pages + 1))
        return pages * mmap.PAGESIZE if self._stray_pages else self.used

    def block(self, nstep: int) -> int:
        """Return the reading of a block of steps."""

        def step() -> None:
            self.used += round(self._bytes_per_step * nstep)

        section = growth_section(step, nstep, self.resident_bytes)
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


def noisy_verdict(baseline: float, candidate: float, nstep: int) -> Verdict:
    """Return the verdict on processes of which two pages come and go."""
    ratios = [
        math.log(
            Process(candidate, 2, 2 * seed + 1).block(nstep)
            / Process(baseline, 2, 2 * seed).block(nstep)
        )
        for seed in range(20)
    ]
    return judge(ratios, 0.01, 0.99, 0.005).verdict


def test_pages_that_come_and_go_are_no_growth_and_hide_no_leak_of_20_bytes_a_step() -> None:
    assert noisy_verdict(0.0, 0.0, GROWTH_NSTEP) == Verdict.SAME
    assert noisy_verdict(0.0, 20.0, GROWTH_NSTEP) == Verdict.SLOWER
    assert noisy_verdict(20.0, 0.0, GROWTH_NSTEP) == Verdict.FASTER
    assert noisy_verdict(0.0, 0.0, GROWTH_NSTEP // 10) == Verdict.INCONCLUSIVE  # too few steps


@pytest.mark.parametrize("nstep", [1, 12, 13, 250])
def test_a_block_takes_as_many_steps_as_asked_for(
    nstep: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    repeated = workload.make(models.load(models.resolve("cartpole")), nbatch=2, nstep=50)
    taken: list[int] = []
    monkeypatch.setattr(mujoco, "mj_step", lambda model, data, nstep: taken.append(nstep))
    memory_blocks._stepping(repeated, nstep)()
    assert sum(taken) == nstep


def test_memory_that_this_process_takes_is_seen_and_that_it_frees_is_not() -> None:
    before = memory_blocks.used_bytes()
    taken = [bytearray(b"x" * 100_000) for _ in range(200)]  # glibc has them in its heap
    last = bytearray(b"x" * 100_000)
    assert memory_blocks.used_bytes() - before > 19 * MB
    taken.clear()
    assert memory_blocks.used_bytes() - before < MB
    assert len(last) == 100_000


def test_growth_is_unknown_where_the_system_does_not_say_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(machine, "resident_bytes", lambda: None)
    with pytest.raises(UnavailableError, match="under Linux only"):
        memory_blocks.section_of(Metric.GROWTH, lambda: None, 10)


def test_steps_of_a_model_add_next_to_nothing() -> None:
    worker = Worker(cast(Connection, None))
    worker.model = models.load(models.resolve("cartpole"))
    worker.workload = workload.make(worker.model, nbatch=1, nstep=10)
    try:
        assert memory_blocks.prepare_growth(worker, ()) > 0
        (section,) = worker.sections
        section.warm_up()
        section.run()
        assert section.reading is not None
        assert GROWTH_UNIT_BYTES <= section.reading() < GROWTH_UNIT_BYTES + 0.1 * MB
    finally:
        gc.unfreeze()
        gc.enable()
