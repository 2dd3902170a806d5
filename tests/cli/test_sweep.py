"""`mjbench sweep` as a user types it: what it prints, stores and measures again; without Ray."""

import contextlib
import functools
import json
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import pytest
from commands import mjbench

from mjbench.commands.sweep import ray_cluster as sweep
from mjbench.commands.sweep.ray_cluster import Cell, CellResult
from mjbench.results import run_writer, runs
from mjbench.results.runs import RunHeader
from mjbench.status import Status

PLAN = 'command = "latency {model}"\n[matrix]\nmodel = ["cartpole", "pile"]\n'
FOLDER = "results/sweeps/plan"
Measure = Callable[..., Iterator[tuple[Cell, CellResult]]]


@pytest.fixture
def planned(tmp_path: Path) -> Path:
    (tmp_path / "plan.toml").write_text(PLAN)
    return tmp_path


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[Cell]:
    """Have a cluster measure each cell, and fail for `pile`; return what it was asked for."""
    asked: list[Cell] = []

    def measure(cells: Sequence[Cell], *arguments: object) -> Iterator[tuple[Cell, CellResult]]:
        asked.extend(cells)
        for cell in cells:
            yield cell, failed() if "pile" in cell.words else measured()

    use(monkeypatch, measure)
    return asked


def use(monkeypatch: pytest.MonkeyPatch, measure: Measure) -> None:
    monkeypatch.setattr(sweep, "cluster", lambda *arguments: contextlib.nullcontext())
    monkeypatch.setattr(sweep, "measure", measure)


@functools.cache
def measured() -> CellResult:
    from mjbench.host import machine

    header = RunHeader(runs.SCHEMA, "latency", machine.describe(), {})
    return CellResult(Status.OK, content=run_writer.line_of(header).encode())


def failed() -> CellResult:
    return CellResult(Status.FAILED, "the disk is full")


def test_a_dry_run_says_what_there_is_to_do_and_measures_nothing(planned: Path) -> None:
    done = mjbench("sweep", "plan.toml", "--dry-run", cwd=planned)
    assert done.returncode == 0, done.stderr
    assert "2 results, 2 of them missing" in done.stdout
    assert "latency cartpole  missing" in done.stdout
    assert list(planned.iterdir()) == [planned / "plan.toml"]


def test_a_failed_cell_is_a_row_that_says_why(planned: Path, asked: list[Cell]) -> None:
    done = mjbench("sweep", "plan.toml", "--json", "out.json", cwd=planned)
    assert done.returncode == 3
    assert "2 results, 1 of them missing" in done.stdout
    assert "latency pile      failed: the disk is full" in done.stdout
    first, second = json.loads((planned / "out.json").read_text())["results"]
    assert second == {
        "command": "mjbench latency pile",
        "machine": "",
        "file": None,
        "status": "failed",
        "detail": "the disk is full",
    }
    assert (planned / first["file"]).read_bytes() == measured().content
    assert len(asked) == 2


def test_only_what_is_missing_is_measured_again(planned: Path, asked: list[Cell]) -> None:
    mjbench("sweep", "plan.toml", "--results", "runs", cwd=planned)
    asked.clear()
    mjbench("sweep", "plan.toml", "--results", "runs", cwd=planned)
    assert [cell.words for cell in asked] == [("latency", "pile")]


def test_ctrl_c_keeps_what_has_arrived(planned: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def measure(cells: Sequence[Cell], *arguments: object) -> Iterator[tuple[Cell, CellResult]]:
        yield cells[0], measured()
        raise KeyboardInterrupt

    use(monkeypatch, measure)
    done = mjbench("sweep", "plan.toml", cwd=planned)
    assert done.returncode == 130
    assert "interrupted; what was measured is saved" in done.stderr
    assert "2 results, 1 of them missing" in done.stdout
    assert len(list((planned / FOLDER).iterdir())) == 1


def test_a_run_file_that_cannot_be_read_is_a_row_that_says_why(
    planned: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def measure(cells: Sequence[Cell], *arguments: object) -> Iterator[tuple[Cell, CellResult]]:
        for cell in cells:
            yield cell, CellResult(Status.OK, content=b"[]\n")

    use(monkeypatch, measure)
    done = mjbench("sweep", "plan.toml", cwd=planned)
    assert done.returncode == 0
    assert done.stdout.count("not a run file") == 2


@pytest.mark.usefixtures("asked")
def test_results_that_cannot_be_stored_are_one_line(planned: Path) -> None:
    done = mjbench("sweep", "plan.toml", "--results", "/proc/here", cwd=planned)
    assert done.returncode == 3
    assert done.stderr.startswith("mjbench: cannot write /proc/here")
    assert done.stderr.count("\n") == 1
