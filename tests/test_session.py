"""What measurements of several models share."""

from pathlib import Path

from mjbench.commands.profile.habit_timing import OverheadRow
from mjbench.measuring.budget import Budget
from mjbench.paired.targets import Target
from mjbench.releases.release_names import ReleaseSpec
from mjbench.session import Observer, input_files, of_each_model
from mjbench.simulation import models
from mjbench.simulation.models import ModelSource
from mjbench.simulation.starts import DEFAULT_STARTS
from mjbench.status import Status


def test_a_continued_run_measures_only_the_models_that_did_not_end_well() -> None:
    measured: list[str] = []

    def measure(source: ModelSource, budget_s: float) -> list[OverheadRow]:
        measured.append(source.name)
        return [OverheadRow(model=source.name)]

    sources = [models.resolve(name) for name in ("cartpole", "humanoid", "pile")]
    each = of_each_model("overhead", sources, DEFAULT_STARTS, OverheadRow, measure, Budget(1.0))
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


def test_wheels_of_a_release_and_of_packages_beside_it_are_among_the_files() -> None:
    mujoco, tool = Path("mujoco.whl"), Path("tool.whl")
    release = ReleaseSpec("x", "4.0.0", (mujoco,), (tool,), has_packages=True)
    model = models.resolve("cartpole")
    files = [model.path, mujoco, tool]
    assert input_files([model], [release], DEFAULT_STARTS) == files
    assert Target(release, model).files == files
