"""Runs in the formats of other tools."""

import csv
import dataclasses
import json
from pathlib import Path
from xml.etree import ElementTree

import pytest
from click.testing import CliRunner
from commands import ROOT
from verdict_records import FAILED, OPEN, SLOWER

import mjbench
from mjbench.cli import cli
from mjbench.commands.show import exports, forms
from mjbench.commands.show.kinds import RECORD_TYPES
from mjbench.commands.show.reports import NamedRun
from mjbench.errors import InputError
from mjbench.results import runs
from mjbench.results.runs import Record, Run

COMPARISON = ROOT / "results/runs/reference-mujoco-4.0.0.jsonl"


def file_of(run: Run, *records: Record, **header: str) -> Run:
    """Return a run with other records, or another header."""
    return Run(dataclasses.replace(run.header, **header), records or run.records)


@pytest.fixture(scope="module")
def comparison() -> Run:
    return runs.load(COMPARISON, RECORD_TYPES)


def csv_of(run: Run) -> str:
    return forms.of_runs([NamedRun(COMPARISON, run)]).csv()


def empty(comparison: Run) -> Run:
    """Return a run in which nothing was measured."""
    return Run(comparison.header, ())


def verdict_run(comparison: Run) -> Run:
    """Return a run with a slower, an undecided and a failed comparison."""
    return file_of(comparison, SLOWER, OPEN, FAILED)


def test_a_run_is_a_flat_table() -> None:
    table = mjbench.load(COMPARISON)
    assert len({tuple(row) for row in table}) == 1
    assert {row["model"] for row in table} >= {"cartpole", "humanoid"}
    speeds = [row["step_ns"] for row in table if row["status"] == "ok"]
    assert all(isinstance(speed, float) for speed in speeds)


@pytest.mark.parametrize("file", sorted((ROOT / "results/runs").glob("*.jsonl")))
def test_every_committed_run_is_a_table(file: Path) -> None:
    table = mjbench.load(file)
    assert table
    cells = {type(cell) for row in table for cell in row.values()}
    assert cells <= {str, int, float, bool, type(None)}


def test_csv_has_a_line_for_each_result(comparison: Run) -> None:
    lines = list(csv.DictReader(csv_of(comparison).splitlines()))
    assert len(lines) == len(mjbench.load(COMPARISON))
    assert csv_of(empty(comparison)) == "\r\n"


def test_benchmark_tools_get_names_units_and_values(comparison: Run) -> None:
    entries = json.loads(exports.as_github_action_benchmark(comparison))
    assert {entry["unit"] for entry in entries} == {"ns/step"}
    assert len({entry["name"] for entry in entries}) == len(entries)
    first, *_ = json.loads(exports.as_github_action_benchmark(verdict_run(comparison)))
    assert first == {
        "name": "m: 1.0.0 → 2.0.0",
        "unit": "ratio",
        "value": 1.03,
        "range": "1.02 to 1.04",
    }


def test_a_run_without_times_or_ratios_has_no_benchmark_form(comparison: Run) -> None:
    with pytest.raises(InputError, match="did not count instructions"):
        exports.as_junit(empty(comparison))


def test_junit_tells_failures_errors_and_open_verdicts_apart(comparison: Run) -> None:
    suite = ElementTree.fromstring(exports.as_junit(verdict_run(comparison)).encode())
    assert [suite.get(name) for name in ("tests", "failures", "errors", "skipped")] == [
        *("3", "1", "1", "1")
    ]
    failure = suite.find("testcase/failure")
    assert failure is not None
    assert "slower by 3" in str(failure.get("message"))
    assert ElementTree.fromstring(exports.as_junit(comparison).encode()).get("failures") == "0"


def test_the_command_writes_every_format(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    flags = ["--html", "--markdown", "--csv", "--json", "--junit", "--github-benchmark"]
    words = ["show", str(COMPARISON), *(word for flag in flags for word in (flag, f"a{flag}"))]
    result = CliRunner().invoke(cli, words)
    assert result.exit_code == 0, result.output
    assert {*result.stdout.splitlines()} == {f"Written: a{flag}" for flag in flags}
    assert all((tmp_path / f"a{flag}").read_text() for flag in flags)
