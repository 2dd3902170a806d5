"""The first line about a program says what matters most."""

import io
from dataclasses import replace
from typing import Any

import pytest
from rich.console import Console

from mjbench.program.activities import Activity, Place
from mjbench.program.calls import CallTime
from mjbench.program.loop_time import LoopTime
from mjbench.program.records import LoopReport, ProgramRow
from mjbench.program.remedy import Basis, Remedy, RemedyKind
from mjbench.program.source_loops import SourceLoop
from mjbench.report import program
from mjbench.status import Status

PLACE = Place("train.py", 7, "main", "mj_step(model, data)")


def loop(activities: dict[Activity, float], samples: int = 100, **more: Any) -> LoopTime:
    return LoopTime(
        loop=SourceLoop("train.py", 5, 9),
        own_files=["train.py"],
        threads=["MainThread"],
        pids=[1],
        in_main=True,
        samples=samples,
        seconds=2.0,
        activities=activities,
        packages={},
        lines=[],
        inner_functions=[],
        engine_clock=0.0,
        **more,
    )


def row(time: LoopTime, *remedies: Remedy, **more: Any) -> ProgramRow:
    return ProgramRow(
        program="train.py",
        status=Status.OK,
        detail="",
        exit_code=0,
        was_ended=False,
        wall_s=3.0,
        rate_hz=100,
        samples=300,
        paused_share=0.0,
        loops=[LoopReport(time, remedies)],
        steps=[],
        **more,
    )


def remedy(basis: Basis = Basis.PAIRED) -> Remedy:
    return Remedy(
        RemedyKind.CALL,
        Activity.PHYSICS,
        PLACE,
        "do otherwise",
        gain=0.4,
        gain_error=None,
        basis=basis,
        share=0.5,
    )


MIXED = loop({Activity.PHYSICS: 0.6, Activity.PYTHON: 0.4})


def test_a_measured_gain_is_said_as_the_time_that_remains() -> None:
    said = program.conclusion(row(MIXED, remedy()))
    assert said == (
        "first, at train.py:7, do otherwise: 50 % of the loop now; with the change, the loop takes"
        " about 0.60 of today's time"
    )


def test_a_bound_is_said_as_a_share_of_the_loop() -> None:
    said = program.conclusion(row(MIXED, remedy(Basis.BOUND)))
    assert said == ("first, physics at train.py:7: 40 % of the loop in train.py:5–9; do otherwise")


def test_a_crash_comes_before_a_wrong_result_and_that_before_time() -> None:
    wrong = Remedy(RemedyKind.RESULT, None, PLACE, "a view is stored", None, None)
    both = row(MIXED, remedy(), wrong=[wrong])
    assert program.conclusion(both) == (
        "first, correct a wrong result at train.py:7: a view is stored"
    )
    crashed = replace(both, crash=PLACE, exit_code=139)
    assert program.conclusion(crashed).startswith("it crashed (SIGSEGV) at train.py:7")


@pytest.mark.parametrize(
    ("time", "text"),
    [
        (loop({Activity.PHYSICS: 0.97, Activity.PYTHON: 0.03}), "`mjbench tune`"),
        (loop({Activity.PHYSICS: 0.5, Activity.REST: 0.5}, samples=10), "run for 6 s or longer"),
        (loop({Activity.COMPILING: 0.9, Activity.REST: 0.1}), "JAX compiles for 1.8 s of the 2 s"),
    ],
)
def test_where_nothing_is_worth_a_change_the_reason_and_the_next_step_are_said(
    time: LoopTime, text: str
) -> None:
    assert text in program.conclusion(row(time))


def test_growth_of_memory_is_said_with_what_creates_objects() -> None:
    call = CallTime("MjData", 1, 1, PLACE, None, 300.0, 0.1, 0, 1, 0, 0)
    grown = row(replace(MIXED, calls=[call]), memory_growth_bytes=223 << 20)
    out = io.StringIO()
    program.print_program(Console(file=out, width=200), grown)
    assert "Memory grew by 223 MiB while it stepped; train.py:7 makes 300 × MjData." in (
        out.getvalue()
    )
