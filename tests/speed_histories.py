"""Invented records of ratios to the reference, and histories of a model."""

import math
from collections.abc import Sequence
from dataclasses import fields
from typing import Any

from set_files import labelled, run_of

from benchmarks.history import speed_series
from benchmarks.history.release_ratios import (
    LaunchRatio,
    OperationRatioRecord,
    RatioRecord,
    StepRatioRecord,
)
from benchmarks.history.speed_series import SpeedSeries
from mjbench.counts.records import ExplainRecord, FunctionDifference, Pair
from mjbench.releases.placement import Placement
from mjbench.results.runs import Run
from mjbench.simulation.reference_run import Work
from mjbench.status import Status

VERSIONS = [f"1.{i}" for i in range(12)]
SPREAD = 0.002


def record(
    release: str,
    ratio: float,
    model: str = "pile",
    status: Status = Status.OK,
    contacts: float = 5.0,
    drift: float | None = 0.0,
    workload: str = "a",
    shipped: float = 1.0,
) -> StepRatioRecord:
    """Return a record whose launches spread by SPREAD; as shipped the ratio is another one."""
    log_ratio = math.log(ratio)
    launches = [
        LaunchRatio(log_ratio + sign * SPREAD, Placement(residue, residue))
        for residue in (0, 16, 32, 48)
        for sign in (-1, 1)
    ]
    launches += [LaunchRatio(log_ratio + math.log(shipped) + x) for x in (-SPREAD, SPREAD)]
    return StepRatioRecord(
        model=model,
        release=release,
        build=release,
        reference="4.0.0",
        status=status,
        launches=launches,
        work=Work(contacts, 4 * contacts, 2.0),
        drift=drift,
        workload=workload,
        reference_s=2e-6,
    )


def operation_record(operation: str, release: str, ratio: float, **others: Any) -> RatioRecord:
    """Return a record of an operation, whose title is its first word."""
    of_step = {
        each.name: getattr(record(release, ratio), each.name) for each in fields(RatioRecord)
    }
    title = operation.partition(" ")[0]
    return OperationRatioRecord(**{**of_step, "operation": operation, "title": title, **others})


def history(ratios: Sequence[float]) -> SpeedSeries:
    """Return the history of a model in the first of VERSIONS."""
    records = [record(v, r) for v, r in zip(VERSIONS, ratios, strict=False)]
    (only,) = speed_series.histories(records)
    return only


def history_run(machine: str, ratios: Sequence[float], model: str = "pile") -> Run:
    """Return a run of the history on a machine that the user gave a name."""
    records = [record(v, r, model) for v, r in zip(VERSIONS, ratios, strict=False)]
    return run_of("history", *records, machine=labelled(machine))


# A model that becomes slower by a quarter, and the instructions of the releases around the change.
STEP = history([1.0] * 6 + [1.25] * 6)
COUNTS = ExplainRecord(
    model="pile",
    old="1.5",
    new="1.6",
    status=Status.OK,
    instructions_per_step=Pair(1000.0, 1200.0),
    outside_per_step=Pair(None, None),
    work=Pair(None, None),
    stages={},
    functions=[
        FunctionDifference(name="mj_island", old=100.0, new=290.0, difference=190.0),
        FunctionDifference(name="mj_crb", old=10.0, new=20.0, difference=10.0),
    ],
    time=None,
)
COUNTED = {("pile", "1.5", "1.6"): COUNTS}
