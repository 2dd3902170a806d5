"""`mjbench history` and its subcommands as a user types them."""

import json
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from benchmarks.history.release_ratios import (
    REFERENCE,
    LaunchRatio,
    RatioRecord,
    StepRatioRecord,
)
from benchmarks.history.tasks import ReleaseTask
from mjbench.cli import cli
from mjbench.counts.counted_program import OperationRequest
from mjbench.counts.instructions import InstructionCounter, ModelCount
from mjbench.counts.records import FunctionCount
from mjbench.errors import Failure
from mjbench.paired import operations
from mjbench.paired.operations import registry
from mjbench.paired.worker_pool import WorkerPool
from mjbench.releases.placement import Placement
from mjbench.releases.release_names import ReleaseSpec
from mjbench.simulation.models import ModelSource
from mjbench.simulation.reference_run import Work
from mjbench.status import Status

LAUNCHES = [
    *(LaunchRatio(x, Placement(r, r)) for r in (0, 16, 32, 48) for x in (0.09, 0.11)),
    LaunchRatio(0.2),
    LaunchRatio(0.2),
]


@pytest.fixture(autouse=True)
def in_its_own_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)


def invoke(*words: str) -> Result:
    return CliRunner().invoke(cli, ["history", *words])


def only_run_file() -> Path:
    (file,) = Path("results/history").glob("*.jsonl")
    return file


def measured(
    monkeypatch: pytest.MonkeyPatch,
    status: Callable[[ReleaseTask], Status] = lambda task: Status.OK,
) -> list[tuple[str, str]]:
    """Have no time measured; return the list of what is to be."""
    measured: list[tuple[str, str]] = []

    def measure_each(
        pool: WorkerPool,
        releases: Sequence[Sequence[ReleaseTask]],
        on_launch: Callable[[int, float], None],
    ) -> Iterator[list[RatioRecord]]:
        records = [records_of(tasks) for tasks in releases]
        for index in reversed(range(len(releases))):  # they end in any order
            on_launch(index, 1.0)
            yield records[index]

    def records_of(tasks: Sequence[ReleaseTask]) -> list[RatioRecord]:
        records: list[RatioRecord] = []
        for task in tasks:
            reference, release = task.releases
            assert reference.version == REFERENCE
            measured.append((task.series, release.version))
            if status(task) != Status.OK:
                task.failure = Failure(status(task), "it fell over")
            task.launches += LAUNCHES
            record = task.record("", 1.0)
            if isinstance(record, StepRatioRecord):
                work = {"work": Work(1.0, 4.0, 2.0), "reference_work": Work(5.0, 20.0, 2.0)}
                record = replace(record, **work)
            records.append(record)
        return records

    monkeypatch.setattr(history_measurement, "measure_each", measure_each)
    return measured


def test_releases_are_measured_stored_and_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    targets = measured(monkeypatch)
    words = ("3.3.0", "3.3.1", "--model", "pile", "--model", "cloth")
    done = invoke("measure", *words, "--json", "out.json")
    assert done.exit_code == 0, done.output
    assert targets == [(m, r) for r in ("3.3.0", "3.3.1") for m in ("pile", "cloth")]
    assert "+10.5 ±0.6 %" in done.output
    assert "+22.1 ±1.1 %" in done.output
    assert "contacts 5 → 1" in done.output
    rows = json.loads(Path("out.json").read_text())["results"]
    assert [row["release"] for row in rows] == ["3.3.0", "3.3.0", "3.3.1", "3.3.1"]
    shown = CliRunner().invoke(cli, ["show", str(only_run_file()), "--json", "shown.json"])
    assert "+10.5 ±0.6 %" in shown.output
    assert json.loads(Path("shown.json").read_text())["results"] == rows


def test_operations_are_measured_too(monkeypatch: pytest.MonkeyPatch) -> None:
    targets = measured(monkeypatch)
    words = ("3.3.0", "--model", "pile", "--operations")
    done = invoke("measure", *words, "--json", "out.json")
    assert done.exit_code == 0, done.output
    assert targets == [("pile", "3.3.0"), *((name, "3.3.0") for name in operations.registry())]
    document = json.loads(Path("out.json").read_text())
    assert [row["operation"] for row in document["operations"]] == [*operations.registry()]
    assert "another result" in done.output  # their drift is unknown
    page = invoke().output
    assert "## Change points around the step" in page
    assert "| mj_ray, humanoid |" in page.replace("---:", "")


def test_operations_can_be_measured_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    targets = measured(monkeypatch)
    done = invoke("measure", "3.3.0", "--no-steps", "--json", "out.json")
    assert done.exit_code == 0, done.output
    assert targets == [(name, "3.3.0") for name in operations.registry()]
    document = json.loads(Path("out.json").read_text())
    assert document["results"] == []
    assert len(document["operations"]) == len(targets)
    page = invoke()
    assert page.exit_code == 2
    assert "there are no times of steps" in page.output


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--model", "pile"), "--model is for steps"),
        (("--no-operations",), "nothing is left"),
    ],
)
def test_without_steps_some_options_make_no_sense(options: tuple[str, ...], message: str) -> None:
    done = invoke("measure", "3.3.0", "--no-steps", *options)
    assert done.exit_code == 2
    assert message in done.output


def test_what_was_measured_is_not_measured_again_and_what_failed_is(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    measured(monkeypatch, lambda t: Status.FAILED if t.series == "cloth" else Status.OK)
    words = ("3.3.0", "--model", "pile", "--model", "cloth")
    done = invoke("measure", *words)
    assert done.exit_code == 3
    assert "it fell over" in done.output
    targets = measured(monkeypatch)
    again = invoke("measure", *words, "--resume", str(only_run_file()))
    assert again.exit_code == 0
    assert targets == [("cloth", "3.3.0")]


def test_without_releases_those_of_the_git_history_are_measured(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    targets = measured(monkeypatch)
    words = ("measure", "--since", "3.16.0", "--model", "pile")
    assert invoke(*words).exit_code == 0
    assert targets == [("pile", release) for release in ("3.16.0", "3.17.0", "4.0.0")]


def test_without_any_selection_every_release_that_can_be_measured_is(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    targets = measured(monkeypatch)
    assert invoke("measure", "--model", "pile").exit_code == 0
    assert targets[0] == ("pile", "2.3.7")
    assert targets[-1] == ("pile", "4.0.0")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("measure", "--since", "9.9"), "has no release 9.9; it has 42, from 2.3.7 to 4.0.0"),
        (("measure", "3.3.0", "--since", "3.3.0"), "give RELEASEs or --since, not both"),
        (("measure", "tea"), "'tea' is not a release"),
        (("measure", "3.3.0", "--model", "tea"), "no model 'tea'"),
        (("explain", "3.3.0"), "give two releases or more"),
    ],
)
def test_what_cannot_be_measured_is_refused_in_a_line(words: Sequence[str], message: str) -> None:
    done = invoke(*words)
    assert done.exit_code == 2
    assert message in done.output
    assert not Path("results").exists()


def count(release: str, source: ModelSource, **functions: float) -> ModelCount:
    return ModelCount(
        model=source.name,
        release=release,
        instructions_per_step=sum(functions.values()),
        functions=[FunctionCount(name, cost, cost) for name, cost in functions.items()],
    )


def test_instructions_are_counted_from_release_to_release(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    counted: list[str] = []
    costs = {"3.3.0": 100.0, "3.3.1": 150.0, "3.3.2": 150.0, REFERENCE: 1.0}

    def count_release(
        counter: InstructionCounter, release: ReleaseSpec, sources: Sequence[ModelSource]
    ) -> list[ModelCount]:
        counted.extend([release.version] * bool(sources))
        cost = costs[release.version]
        return [count(release.version, s, mj_step=900.0, getTime=cost) for s in sources]

    monkeypatch.setattr("mjbench.counts.instructions.unavailable", lambda: None)
    monkeypatch.setattr(InstructionCounter, "count", count_release)
    words = ("3.3.0", "3.3.1", "3.3.2", "--model", "pile")
    done = invoke("explain", *words)
    assert done.exit_code == 0, done.output
    assert counted == [REFERENCE, "3.3.0", "3.3.1", "3.3.2"]
    assert "+5.0 %" in done.output
    assert "getTime +50" in done.output
    records = [json.loads(line) for line in only_run_file().read_text().splitlines()[1:]]
    assert [(r["type"], r["old"], r["new"]) for r in records] == [
        ("explain", "3.3.0", "3.3.1"),
        ("explain", "3.3.1", "3.3.2"),
    ]
    shown = CliRunner().invoke(cli, ["show", str(only_run_file())])
    assert "getTime +50" in shown.output
    again = invoke("explain", *words, "--resume", str(only_run_file()))
    assert again.exit_code == 0
    assert len(only_run_file().read_text().splitlines()) == 3


def test_instructions_of_operations_are_counted_and_explain_their_changes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    costs = {"3.3.0": 100.0, "3.3.1": 150.0}

    def count_release(
        counter: InstructionCounter, release: ReleaseSpec, requests: Sequence[OperationRequest]
    ) -> list[ModelCount]:
        cost = costs[release.version]
        return [
            ModelCount(
                model=request.source.name if request.source else "",
                operation=request.operation,
                release=release.version,
                instructions_per_step=900.0 + cost,
                functions=[FunctionCount("mjXReader::Parse", cost, cost)],
            )
            for request in requests
        ]

    monkeypatch.setattr("mjbench.counts.instructions.unavailable", lambda: None)
    monkeypatch.setattr(InstructionCounter, "count", count_release)
    done = invoke("explain", "3.3.0", "3.3.1", "--no-steps")
    assert done.exit_code == 0, done.output
    assert "load pile" in done.output
    assert "mjXReader::Parse +50" in done.output
    records = [json.loads(line) for line in only_run_file().read_text().splitlines()[1:]]
    assert [r["operation"] for r in records] == [*registry()]
    assert {r["model"] for r in records} == {"cartpole", "humanoid", "pile", ""}
    again = invoke("explain", "3.3.0", "3.3.1", "--no-steps", "--resume", str(only_run_file()))
    assert again.exit_code == 0
    assert len(only_run_file().read_text().splitlines()) == 1 + len(registry())


def test_change_points_are_reported_from_what_was_measured_and_counted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    measured(monkeypatch)
    words = ("3.3.0", "3.3.1", "3.3.2", "--model", "pile")
    assert invoke("measure", *words).exit_code == 0
    done = invoke("-o", "page.md")
    assert done.exit_code == 0, done.output
    page = Path("page.md").read_text()
    assert page.startswith("# What changed between releases\n\n")
    assert "slower for 0 of 1 model, and faster for 0" in page
    assert "| pile | 3.3.0 | 3.3.2 | +0.0 ±" in page
    assert "\n| 3.3.0 | " in page
    since = invoke("--since", "3.3.1").output
    assert since == page.replace("| 3.3.0 | – |\n", "")


def test_plots_are_drawn_and_linked(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("vl_convert", reason="plots need vl-convert-python")
    measured(monkeypatch)
    assert invoke("measure", "3.3.0", "3.3.1", "--model", "pile").exit_code == 0
    done = invoke("--plots", "docs/plots", "-o", "docs/page.md")
    assert done.exit_code == 3  # there is no such folder
    assert "cannot write docs/page.md" in done.output
    Path("docs").mkdir()
    done = invoke("--plots", "docs/plots", "-o", "docs/page.md")
    assert done.exit_code == 0, done.output
    assert "![pile](plots/pile.svg)" in Path("docs/page.md").read_text()
    assert Path("docs/plots/pile.svg").read_text().startswith("<svg")


def test_without_the_package_that_draws_plots_its_name_is_said(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    measured(monkeypatch)
    invoke("measure", "3.3.0", "--model", "pile")
    monkeypatch.setitem(sys.modules, "vl_convert", None)
    done = invoke("--plots", "plots")
    assert done.exit_code == 3
    assert "charts need vl-convert-python" in done.output
    assert not Path("plots").exists()


def test_changes_of_nothing_and_since_no_release_are_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    done = invoke()
    assert done.exit_code == 2
    assert "there are no times of steps; `mjbench history measure` measures some" in done.output
    measured(monkeypatch)
    invoke("measure", "3.3.0", "--model", "pile")
    done = invoke("--since", "9.9")
    assert done.exit_code == 2
    assert "9.9 was not measured; these releases were: 3.3.0" in done.output
    done = invoke("-o", str(only_run_file()))
    assert done.exit_code == 2


# several machines


def machines(*labels: str) -> None:
    """Have the run file in the folder measured on several machines."""
    file = only_run_file()
    header, *rest = file.read_text().splitlines(keepends=True)
    file.unlink()
    for label in labels:
        of_machine = json.loads(header)
        of_machine["machine"]["label"] = label
        lines = [json.dumps(of_machine) + "\n", *rest]
        Path(f"results/history/{label}.jsonl").write_text("".join(lines))


def test_each_of_several_machines_has_a_page(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    measured(monkeypatch)
    invoke("measure", "3.3.0", "3.3.1", "--model", "pile")
    single = invoke().output
    machines("a", "b")
    done = invoke()
    assert done.exit_code == 2
    assert "there are several machines: a, b; give --machine NAME for one" in done.output
    assert invoke("--machine", "b").output == single
    done = invoke("--machine", "c")
    assert done.exit_code == 2
    assert "no machine c; there are a, b" in done.output
