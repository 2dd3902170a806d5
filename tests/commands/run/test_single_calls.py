"""A program that is one long call is told what that call takes, and which threads it uses."""

from dataclasses import replace

import pytest

from mjbench.commands.run import single_calls
from mjbench.commands.run.activities import Place
from mjbench.commands.run.call_times import CallThreads, CallTime
from mjbench.commands.run.hook.call_clock import THREADED_ROLLOUT
from mjbench.commands.run.source_loops import SourceLoop

PLACE = Place("roll.py", 6, "<module>", "rollout.rollout(model, data, states)")
CALL = CallTime(
    "rollout", 1, 1, PLACE, None, 1, 4.0, 0, 4_000_000_000, 1000, 64_000,
    threads=CallThreads(1, 0, has_sensors=True),
)  # fmt: skip


def sentence(call: CallTime, cores: int = 8) -> str:
    (single,) = single_calls.single_calls([call], cores)
    return single.sentence(5.0)


def test_the_report_on_a_call_is_its_time_a_step_its_threads_and_the_instant_of_its_rows() -> None:
    assert sentence(CALL) == (
        "rollout at roll.py:6 takes 4 s of the program's 5 s: 62.5 µs a step, of 64 simulations ×"
        " 1,000 steps, on 1 of 8 cores. A list of 8 MjData uses 8 threads. Row k of its sensor data"
        " is of the state before step k, that of states after it"
    )


@pytest.mark.parametrize(
    ("chunk_size", "says"),
    [
        (
            32,
            "on 8 of 8 cores, in chunks of 32. 6 of its 8 threads get no chunk: chunk_size=8 uses",
        ),
        (10, "in chunks of 10. 1 of its 8 threads gets no chunk: chunk_size=8 uses all"),
        (8, "on 8 of 8 cores, in chunks of 8"),
        (0, "on 8 of 8 cores, in chunks of 1"),
    ],
)
def test_chunks_that_leave_threads_idle_are_said(chunk_size: int, says: str) -> None:
    threads = CallThreads(8, chunk_size, has_sensors=False)
    told = sentence(replace(CALL, callee=THREADED_ROLLOUT, threads=threads))
    assert says in told
    assert ("no chunk" in told) == (chunk_size > 8)


def test_a_batch_has_no_chunks_and_threads_of_its_own() -> None:
    told = sentence(replace(CALL, callee="Batch.rollout"))
    assert told.startswith("Batch.rollout at roll.py:6")
    assert "Batch(…, nthread=0) uses 8 threads" in told
    assert "chunk" not in told


def test_calls_in_a_loop_or_without_steps_are_not_single() -> None:
    calls = [replace(CALL, loop=SourceLoop("roll.py", 5, 6)), replace(CALL, steps=0)]
    assert single_calls.single_calls(calls, 8) == []
