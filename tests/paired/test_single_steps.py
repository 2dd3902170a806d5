"""Steps that are timed one by one: the states of the plain loop, and the 99th percentile."""

import time

import numpy as np
import pytest
from paired_examples import CUBES

from mjbench.paired.single_steps import TimedSteps
from mjbench.simulation import models, work, workload
from mjbench.simulation.workload import Workload


@pytest.fixture
def cubes() -> Workload:
    return workload.make(models.load(CUBES.model), nbatch=4, nstep=50, hold=2, seed=0)


def test_steps_end_in_the_states_of_the_plain_loop(cubes: Workload) -> None:
    steps = TimedSteps(cubes)
    steps.run()
    np.testing.assert_array_equal(steps.final_state, work.observe(cubes).final_state)


def test_99_of_100_steps_take_no_longer(cubes: Workload, monkeypatch: pytest.MonkeyPatch) -> None:
    """The clock is injected: step k takes k nanoseconds, of the 200 in all."""
    order = np.random.default_rng(0).permutation(200)
    readings = iter([reading for k in order for reading in (0, int(k))])
    monkeypatch.setattr(time, "perf_counter_ns", lambda: next(readings))
    steps = TimedSteps(cubes)
    steps.run()
    assert steps.p99_ns() == 197
