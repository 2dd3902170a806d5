"""What measurements of several models share, and what must be the same to continue a run."""

from dataclasses import replace
from pathlib import Path

import pytest

from mjbench import session
from mjbench.commands.profile.habit_timing import OverheadRow
from mjbench.errors import InputError
from mjbench.host import machine
from mjbench.measuring.budget import Budget
from mjbench.paired.targets import Target
from mjbench.releases.release_names import ReleaseSpec
from mjbench.results import runs
from mjbench.session import Observer, input_files, of_each_model
from mjbench.simulation import models
from mjbench.simulation.models import ModelSource
from mjbench.simulation.starts import DEFAULT_STARTS
from mjbench.status import Status

MACHINE = machine.describe()
FILES = (runs.InputFile("a.xml", "1f"), runs.InputFile("a.xml", "2e"))
HEADER = runs.RunHeader(runs.SCHEMA, "compare", MACHINE, {"nbatch": 4}, FILES)


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


def test_the_same_command_continues_a_run_whatever_the_load() -> None:
    busy = replace(HEADER, machine=replace(MACHINE, load_1min=99.0))
    session.check_continues(Path("run"), HEADER, busy)


def test_arguments_are_compared_as_a_file_holds_them() -> None:
    now = replace(HEADER, arguments={"variants": ({"path": "a\x1bb"},)})
    stored = replace(HEADER, arguments={"variants": [{"path": "a\\x1bb"}]})
    session.check_continues(Path("run"), stored, now)


def on(label: str, host: str) -> runs.RunHeader:
    """Return the header of a run on a machine."""
    return replace(HEADER, machine=replace(MACHINE, label=label, host=host))


@pytest.mark.parametrize(
    ("stored", "now"),
    [
        (on("", ""), on("", "a1")),
        (on("", "a1"), on("lab", "a1")),
        (on("lab", "a1"), on("lab", "b2")),  # a container, which is a new host each time
    ],
)
def test_a_run_is_continued_where_the_machine_may_be_the_same(
    stored: runs.RunHeader, now: runs.RunHeader
) -> None:
    session.check_continues(Path("run"), stored, now)


@pytest.mark.parametrize(
    ("stored", "now", "message"),
    [
        (on("", "a1"), on("", "b2"), "the machine's host a1, and this command b2"),
        (on("lab", "a1"), on("other", "a1"), "the machine's label lab, and this command other"),
    ],
)
def test_a_run_of_another_machine_is_not_continued(
    stored: runs.RunHeader, now: runs.RunHeader, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        session.check_continues(Path("run"), stored, now)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"command": "versions"}, "the command compare, and this command versions"),
        ({"arguments": {"nbatch": 8}}, "nbatch 4, and this command 8"),
        ({"arguments": {}}, "nbatch 4, and this command nothing"),
        ({"arguments": {"nbatch": [{"path": "rollout"}]}}, "that run has other nbatch$"),
        ({"files": FILES[:1] * 2}, "a.xml has changed"),
        ({"files": (*FILES, runs.InputFile("b.xml", ""))}, "the files"),
        ({"machine": replace(MACHINE, cpu="other")}, "the processor"),
        ({"machine": replace(MACHINE, versions={"mujoco": "1.0"})}, "mujoco"),
    ],
)
def test_what_differs_is_refused_by_name(change: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        session.check_continues(Path("run"), HEADER, replace(HEADER, **change))  # type: ignore
