"""How a comparison ends where it is interrupted between its steps."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import pytest
from example_races import compared, raced

from mjbench.api import compare
from mjbench.api.session import Item, Observer
from mjbench.comparison.plan import ComparisonPlan
from mjbench.comparison.records import MeasurementRecord, ModelRecord
from mjbench.paired import path_comparison
from mjbench.paired.path_comparison import ModelComparison
from mjbench.paired.race_record import RaceRecord
from mjbench.report.content import Section
from mjbench.simulation import models
from mjbench.status import Status

_Show = Callable[[], Section | None] | None


class Interrupted(Observer):
    """Is interrupted when it shows results for the `at`-th time."""

    def __init__(self, at: int):
        super().__init__()
        self._left = at

    def show(self, section: _Show) -> None:
        self._left -= 1
        if not self._left:
            raise KeyboardInterrupt


def known(**fields: Any) -> ModelComparison:
    model, *measurements, race = compared(raced())
    assert isinstance(model, ModelRecord) and isinstance(race, RaceRecord)
    rows = tuple(row for row in measurements if isinstance(row, MeasurementRecord))
    return ModelComparison(replace(model, **fields), rows, race)


def comparison(*arguments: object) -> Iterator[ModelComparison]:
    """Yield what a comparison does: a part, then all of it, or the part that Ctrl-C leaves."""
    try:
        yield known()
    except KeyboardInterrupt:
        yield known(status=Status.INTERRUPTED)
    else:
        yield known()


@pytest.mark.parametrize(("at", "status"), [(1, Status.INTERRUPTED), (2, Status.OK)])
def test_what_was_measured_is_there_where_showing_it_is_interrupted(
    monkeypatch: pytest.MonkeyPatch, at: int, status: Status
) -> None:
    monkeypatch.setattr(path_comparison, "compare_model", comparison)
    source, plan, pool = models.resolve("cartpole"), ComparisonPlan(variants=()), object()
    items: Iterator[Item] = compare.measure_model(
        pool,
        source,
        [plan],
        [0.0, 1.0],
        (),
        Interrupted(at),  # type: ignore[arg-type]
    )
    first, *_ = next(items).records
    assert isinstance(first, ModelRecord)
    assert first.status == status
    with pytest.raises(KeyboardInterrupt):
        next(items)
