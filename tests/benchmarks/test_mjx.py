"""What the benchmarks of MJX make of the messages of their child."""

import pytest

from benchmarks import mjx
from mjbench.comparison.messages import AgreementReport, BlockTime, CompileReport, PeakMemory
from mjbench.errors import MachineError
from mjbench.host.isolate import Ended
from mjbench.status import Status

OK = Ended(Status.OK)
COMPILED = CompileReport(
    device="cpu", trace_s=1.0, compile_s=2.0, workload_digest="d", buffer_sizes={}
)
AGREES = AgreementReport(index=0, status=Status.OK, agrees=True)
BLOCKS = [BlockTime(0.5), BlockTime(0.25)]
MEMORY = PeakMemory(memory_bytes=1, gpu_memory_bytes=None)


def test_times_are_those_of_the_compiler_and_of_every_block() -> None:
    times = mjx.times_from([COMPILED, AGREES, *BLOCKS, MEMORY], OK)
    assert times == mjx.MjxTimes(compile_s=3.0, block_s=[0.5, 0.25])


def test_a_model_that_mjx_does_not_step_is_not_applicable() -> None:
    report = AgreementReport(index=0, status=Status.UNAVAILABLE, detail="no such joint")
    with pytest.raises(NotImplementedError, match="no such joint"):
        mjx.times_from([report], OK)


def test_an_mjx_that_fails_before_it_is_compiled_is_not_applicable() -> None:
    with pytest.raises(NotImplementedError, match="jax has no attribute"):
        mjx.times_from([], Ended(Status.FAILED, "jax has no attribute"))


@pytest.mark.parametrize(
    ("messages", "ended"),
    [
        ([], Ended(Status.CRASHED, "why")),
        ([], Ended(Status.TIMEOUT, "why")),
        ([COMPILED], Ended(Status.FAILED, "why")),
        ([COMPILED, AGREES, *BLOCKS], Ended(Status.CRASHED, "why")),
        ([COMPILED, AgreementReport(index=0, status=Status.DISAGREES, detail="why")], OK),
    ],
)
def test_an_mjx_that_crashes_or_disagrees_is_an_error(messages: list[object], ended: Ended) -> None:
    with pytest.raises(MachineError, match="why"):
        mjx.times_from(messages, ended)


def test_blocks_that_disagree_after_they_were_timed_are_an_error() -> None:
    late = AgreementReport(index=0, status=Status.DISAGREES, detail="in timed blocks")
    with pytest.raises(MachineError, match="in timed blocks"):
        mjx.times_from([COMPILED, AGREES, *BLOCKS, late, MEMORY], OK)


def test_a_child_that_sends_nothing_or_times_nothing_is_an_error() -> None:
    for messages in ([], [COMPILED], [COMPILED, AGREES, MEMORY]):
        with pytest.raises(MachineError, match="without a result"):
            mjx.times_from(messages, OK)
