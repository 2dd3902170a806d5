"""What the benchmarks of MJX make of the record of their child."""

import dataclasses

import pytest

from benchmarks import mjx
from mjbench.comparison.plan import Variant
from mjbench.comparison.records import MeasurementRecord
from mjbench.errors import MachineError
from mjbench.host.isolate import Ended
from mjbench.status import Status

OK = Ended(Status.OK)
COMPILED = dataclasses.replace(
    MeasurementRecord.of("cartpole", Variant("mjx", {})),
    nbatch=1,
    nstep=1,
    device="cpu",
    trace_s=1.0,
    compile_s=2.0,
)
AGREES = dataclasses.replace(COMPILED, agrees=True)
TIMED = dataclasses.replace(AGREES, samples_s=[0.5, 0.25])


def test_times_are_those_of_the_compiler_and_of_every_block() -> None:
    assert mjx.times_from(TIMED, OK) == mjx.MjxTimes(compile_s=3.0, block_s=[0.5, 0.25])


def test_a_model_that_mjx_does_not_step_is_not_applicable() -> None:
    record = dataclasses.replace(COMPILED, status=Status.UNAVAILABLE, detail="no such joint")
    with pytest.raises(NotImplementedError, match="no such joint"):
        mjx.times_from(record, OK)


def test_an_mjx_that_fails_before_it_is_compiled_is_not_applicable() -> None:
    with pytest.raises(NotImplementedError, match="jax has no attribute"):
        mjx.times_from(None, Ended(Status.FAILED, "jax has no attribute"))


@pytest.mark.parametrize(
    ("record", "ended"),
    [
        (None, Ended(Status.CRASHED, "why")),
        (None, Ended(Status.TIMEOUT, "why")),
        (COMPILED, Ended(Status.FAILED, "why")),
        (TIMED, Ended(Status.CRASHED, "why")),
        (dataclasses.replace(COMPILED, status=Status.DISAGREES, detail="why"), OK),
        (dataclasses.replace(TIMED, status=Status.DISAGREES, detail="why"), OK),
    ],
)
def test_an_mjx_that_crashes_or_disagrees_is_an_error(
    record: MeasurementRecord | None, ended: Ended
) -> None:
    with pytest.raises(MachineError, match="why"):
        mjx.times_from(record, ended)


def test_a_child_that_sends_nothing_or_times_nothing_is_an_error() -> None:
    for record in (None, COMPILED, AGREES):
        with pytest.raises(MachineError, match="without a result"):
            mjx.times_from(record, OK)
