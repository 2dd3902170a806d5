"""`python -m benchmarks.history` as a user types it."""

import importlib
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from example_counts import counted

from benchmarks import operations
from benchmarks.history import plots, timing
from benchmarks.history.release_ratios import REFERENCE, LaunchRatio, RatioRecord, StepRatioRecord
from benchmarks.history.tasks import ReleaseTask
from mjbench.counts.instructions import InstructionCounter, ModelCount
from mjbench.errors import Failure, InputError, MachineError
from mjbench.paired.worker_pool import WorkerPool
from mjbench.releases import package_index
from mjbench.releases.placement import Placement
from mjbench.releases.release import Release
from mjbench.releases.release_names import ReleaseSpec
from mjbench.simulation.models import ModelSource
from mjbench.simulation.reference_run import Work
from mjbench.status import Status

LAUNCHES = [
    *(LaunchRatio(x, Placement(r, r)) for r in (0, 16, 32, 48) for x in (0.09, 0.11)),
    LaunchRatio(0.2),
    LaunchRatio(0.2),
]


pytestmark = pytest.mark.usefixtures("quiet_host")


@pytest.fixture(autouse=True)
def in_its_own_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)


def invoke(*words: str) -> Result:
    command = importlib.import_module("benchmarks.history.__main__").history
    return CliRunner().invoke(command, words)


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

    monkeypatch.setattr(timing, "measure_each", measure_each)
    return measured


def test_releases_are_measured_stored_and_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    targets = measured(monkeypatch)
    done = invoke("measure", "3.3.0", "3.3.1", "--model", "pile", "--model", "cloth")
    assert done.exit_code == 0, done.output
    assert targets == [(m, r) for r in ("3.3.0", "3.3.1") for m in ("pile", "cloth")]
    assert "+10.5 ±0.6 %" in done.output
    assert "+22.1 ±1.1 %" in done.output
    assert "contacts 5 → 1" in done.output


def test_operations_are_measured_too(monkeypatch: pytest.MonkeyPatch) -> None:
    targets = measured(monkeypatch)
    done = invoke("measure", "3.3.0", "--model", "pile", "--operations")
    assert done.exit_code == 0, done.output
    assert targets == [("pile", "3.3.0"), *((name, "3.3.0") for name in operations.registry())]
    assert "another result" in done.output  # their drift is unknown


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
    assert isinstance(done.exception, InputError)
    assert message in str(done.exception)
    assert not Path("results").exists()


def test_instructions_are_counted_from_release_to_release(monkeypatch: pytest.MonkeyPatch) -> None:
    releases: list[str] = []
    costs = {"3.3.0": 100.0, "3.3.1": 150.0, "3.3.2": 150.0, REFERENCE: 1.0}

    def count_release(
        counter: InstructionCounter, release: ReleaseSpec, sources: Sequence[ModelSource]
    ) -> list[ModelCount]:
        releases.extend([release.version] * bool(sources))
        cost = costs[release.version]
        count = counted(release.version, mj_step=900.0, getTime=cost)
        return [replace(count, model=source.name) for source in sources]

    monkeypatch.setattr("mjbench.counts.instructions.unavailable", lambda: None)
    monkeypatch.setattr(InstructionCounter, "count", count_release)
    words = ("3.3.0", "3.3.1", "3.3.2", "--model", "pile")
    done = invoke("explain", *words)
    assert done.exit_code == 0, done.output
    assert releases == [REFERENCE, "3.3.0", "3.3.1", "3.3.2"]
    assert "+5.00 %" in done.output
    assert ["getTime", "100", "150", "+50"] in [line.split() for line in done.output.splitlines()]
    records = [json.loads(line) for line in only_run_file().read_text().splitlines()[1:]]
    assert [(r["type"], r["old"], r["new"]) for r in records] == [
        ("explain", "3.3.0", "3.3.1"),
        ("explain", "3.3.1", "3.3.2"),
    ]
    again = invoke("explain", *words, "--resume", str(only_run_file()))
    assert again.exit_code == 0
    assert len(only_run_file().read_text().splitlines()) == 3


def offline() -> list[Release]:
    raise MachineError("no network")


def test_the_git_history_is_verified_without_the_index(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(package_index, "releases", offline)
    done = invoke("verify")
    assert done.exit_code == 0, done.output
    assert "every hash" in done.output
    assert "Upload times were not checked: no network" in done.output


def test_new_releases_are_appended_to_the_git_history(monkeypatch: pytest.MonkeyPatch) -> None:
    release = Release("3.0.0", datetime(2024, 1, 1, tzinfo=UTC))
    monkeypatch.setattr(package_index, "releases", lambda: [release])
    assert invoke("append", "new.bundle").output == "appended v3.0.0 to new.bundle\n"
    again = "nothing to append: new.bundle ends with v3.0.0\n"
    assert invoke("append", "new.bundle").output == again


def test_the_page_is_written_from_what_was_measured_and_counted(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    measured(monkeypatch)
    assert invoke("measure", "3.3.0", "3.3.1", "--model", "pile").exit_code == 0
    command = importlib.import_module("benchmarks.history.__main__")
    monkeypatch.setattr(command.files, "ROOT", tmp_path)
    monkeypatch.setattr(command, "PAGE", tmp_path / "history.md")
    monkeypatch.setattr(command, "PLOTS", tmp_path / "history")
    monkeypatch.setattr(plots, "draw", lambda history, folder: None)
    done = invoke("page")
    assert done.exit_code == 0, done.output
    page = Path("history.md").read_text()
    assert page.startswith("# What changed between releases\n\n")
    assert "slower for 0 of 1 model, and faster for 0" in page
