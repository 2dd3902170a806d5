"""What the benchmarks of MJX measure in their child; a stub stands for the path."""

from types import SimpleNamespace
from typing import Any

import numpy as np

from benchmarks import mjx, stored
from benchmarks.settings import Cached
from mjbench.paths.base import States
from mjbench.simulation import reference_run
from mjbench.status import Status

NBATCH, NSTEP = 3, 4


class StubPath:
    """Stands for MJX: it ends where C does, or `error` away from it."""

    def __init__(self, error: float = 0.0, reason: str = ""):
        self.error, self.reason, self.runs = error, reason, 0

    def unsuited(self, *_: object) -> str:
        return self.reason

    def prepare(self, simulations: Any, *_: object) -> Any:
        ends = reference_run.observe(simulations).final_state + self.error
        return SimpleNamespace(
            run=self.run,
            clear=lambda: None,
            final_states=lambda: States(ends),
            trace_s=1.0,
            compile_s=2.0,
        )

    def run(self) -> None:
        self.runs += 1


def measured(path: Any) -> Cached[mjx.MjxTimes]:
    channel: Any = None
    return mjx.compile_and_time(path, "cartpole", NBATCH, NSTEP, channel)


def test_times_are_those_of_the_compiler_and_of_every_block() -> None:
    path = StubPath()
    times = measured(path).get()
    assert times.compile_s == 3.0
    assert (len(times.block_s), path.runs) == (mjx.BLOCKS, mjx.BLOCKS + 1)


def test_a_model_that_mjx_does_not_step_is_not_applicable() -> None:
    assert measured(StubPath(reason="no such joint")) == Cached(Status.UNAVAILABLE, "no such joint")


def test_an_mjx_that_fails_before_it_is_compiled_is_not_applicable() -> None:
    path = StubPath()
    path.prepare = lambda *_: [][0]  # type: ignore[method-assign]
    assert measured(path) == Cached(Status.UNAVAILABLE, "IndexError: list index out of range")


def test_a_run_that_ends_elsewhere_than_c_s_has_no_time() -> None:
    simulations = stored.stored_workload("cartpole", NBATCH, NSTEP)
    largest = np.abs(reference_run.observe(simulations).final_state).max()
    result = measured(StubPath(error=largest))
    assert (result.status, result.value) == (Status.FAILED, None)
    assert result.detail == "qpos is not that of C after 4 steps"
