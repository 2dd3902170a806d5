"""What measurements of several models share."""

from mjbench.api.session import Observer, of_each_model
from mjbench.loop.overhead import OverheadRow
from mjbench.simulation import models
from mjbench.simulation.models import ModelSource
from mjbench.simulation.starts import DEFAULT_STARTS
from mjbench.status import Status


def test_a_continued_run_measures_only_the_models_that_did_not_end_well() -> None:
    measured: list[str] = []

    def measure(source: ModelSource) -> list[OverheadRow]:
        measured.append(source.name)
        return [OverheadRow(model=source.name)]

    sources = [models.resolve(name) for name in ("cartpole", "humanoid", "pile")]
    each = of_each_model("overhead", sources, DEFAULT_STARTS, OverheadRow, measure)
    earlier = [
        OverheadRow(model="cartpole"),
        OverheadRow(model="humanoid", status=Status.CRASHED, detail="signal 9"),
    ]
    kept = each.select_finished(earlier)
    items = list(each.measure(kept, Observer()))
    assert measured == ["humanoid", "pile"]
    assert [record.model for item in items for record in item.records] == [
        *("cartpole", "humanoid", "pile")
    ]
    assert items[0].records == [earlier[0]]
