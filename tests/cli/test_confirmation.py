"""What a user sees while paths are compared again in fresh processes."""

import contextlib
from collections.abc import Callable
from typing import Any, cast

import pytest

from mjbench.cli.confirmation import Confirmation, part_of
from mjbench.cli.context import RunContext
from mjbench.comparison.plan import ComparisonPlan, Variant
from mjbench.instrument.runs import Record
from mjbench.paired import contest
from mjbench.paired.confirmation import ComparedSizes
from mjbench.paired.contest import ContestRecord
from mjbench.simulation import models
from mjbench.status import Status


class _Run:
    """A command that stores its records in a list."""

    def __init__(self) -> None:
        self.records: list[Record] = []

    def record(self, record: Record) -> None:
        self.records.append(record)


def test_each_launch_of_a_contest_moves_the_bar(monkeypatch: pytest.MonkeyPatch) -> None:
    def run(*arguments: object, on_launch: Callable[[int, float], None]) -> ContestRecord:
        for launches, share in ((1, 0.25), (2, 0.5)):
            on_launch(launches, share)
        return ContestRecord(model="cartpole", variants=[], status=Status.INTERRUPTED)

    monkeypatch.setattr(contest, "run", run)
    seen: list[tuple[str, float]] = []
    command = _Run()
    with contextlib.ExitStack() as closing:
        confirmation = Confirmation(cast(RunContext, command), closing)
        record = confirmation.contest(
            models.resolve("cartpole"),
            ComparisonPlan(()),
            [[Variant("python_loop", {})]],
            ComparedSizes(1, 1, 1e-6),
            part_of(lambda name, share: seen.append((name, share)), 0.5, 1.0),
        )
    assert [share for _, share in seen] == [0.5, 0.625, 0.75]
    assert seen[-1][0] == "cartpole: fastest paths in fresh processes, launch 2"
    assert confirmation.is_interrupted
    assert cast(list[Any], command.records) == [record]
