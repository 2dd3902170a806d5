"""Runs in the formats of other tools."""

import csv
import dataclasses
import json
from pathlib import Path
from xml.etree import ElementTree

import pytest
from click.testing import CliRunner
from commands import ROOT

import mjbench
from mjbench.cli import cli
from mjbench.commands.show import exports, forms
from mjbench.commands.show.kinds import RECORD_TYPES
from mjbench.commands.show.reports import NamedRun
from mjbench.errors import InputError
from mjbench.interval import Interval
from mjbench.paired.outcomes import Verdict
from mjbench.paired.records import TargetRow, VerdictRecord
from mjbench.results import runs
from mjbench.results.runs import Record, Run
from mjbench.status import Status

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
    sides = [TargetRow(release, "m", "python_loop", {}, {}) for release in ("3.17.0", "4.0.0")]
    fields = {"model": "m", "path": "python_loop", "old": "3.17.0", "new": "4.0.0", "sides": sides}
    ratio = Interval(1.02, 1.01, 1.03)
    records = (
        VerdictRecord(
            **fields, status=Status.OK, verdict=Verdict.SLOWER, ratio=ratio, e_slower=1e6
        ),
        VerdictRecord(**fields, status=Status.OK, verdict=Verdict.INCONCLUSIVE, ratio=ratio),
        VerdictRecord(**fields, status=Status.FAILED, detail="it crashed"),
    )
    return file_of(comparison, *records)


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
        "name": "m: 3.17.0 → 4.0.0",
        "unit": "ratio",
        "value": 1.02,
        "range": "1.01 to 1.03",
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
    assert "slower by 2" in str(failure.get("message"))
    assert ElementTree.fromstring(exports.as_junit(comparison).encode()).get("failures") == "0"


def test_the_command_writes_every_format(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    flags = ["--html", "--markdown", "--csv", "--json", "--junit", "--github-benchmark"]
    words = ["show", str(COMPARISON), *(word for flag in flags for word in (flag, f"a{flag}"))]
    result = CliRunner().invoke(cli, words)
    assert result.exit_code == 0, result.output
    assert {*result.stdout.splitlines()} == {f"Written: a{flag}" for flag in flags}
    assert all((tmp_path / f"a{flag}").read_text() for flag in flags)
