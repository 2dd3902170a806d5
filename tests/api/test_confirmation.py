"""What a user sees while paths are compared again in fresh processes."""

import contextlib
from collections.abc import Callable

import pytest

from mjbench.api.confirmation import Confirmation
from mjbench.comparison.plan import ComparisonPlan, Variant
from mjbench.instrument.progress import part_of
from mjbench.instrument.runs import Record
from mjbench.paired import contest
from mjbench.paired.confirmation import ComparedSizes
from mjbench.paired.contest import ContestRecord
from mjbench.simulation import models
from mjbench.status import Status


def test_each_launch_of_a_contest_moves_the_bar(monkeypatch: pytest.MonkeyPatch) -> None:
    def run(*arguments: object, on_launch: Callable[[int, float], None]) -> ContestRecord:
        for launches, share in ((1, 0.25), (2, 0.5)):
            on_launch(launches, share)
        return ContestRecord(model="cartpole", variants=[], status=Status.INTERRUPTED)

    monkeypatch.setattr(contest, "run", run)
    seen: list[tuple[str, float]] = []
    records: list[Record] = []
    with contextlib.ExitStack() as closing:
        confirmation = Confirmation(records.append, closing)
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
    assert records == [record]
