"""`mjbench tune --engine`: options, and stored searches."""

import json
from pathlib import Path

import pytest
from commands import mjbench
from tuning_values import ENGINE_TUNE
from tuning_values import stored as stored_record


@pytest.fixture
def stored(tmp_path: Path) -> Path:
    """Return a run file of an earlier version."""
    return Path(stored_record(tmp_path, ENGINE_TUNE))


def test_a_stored_search_is_printed_again_with_its_document(stored: Path) -> None:
    done = mjbench("show", str(stored))
    assert done.returncode == 0, done.stderr
    assert "robot on Warp: 1.25 times as fast without a larger transfer error" in done.stdout
    assert ["yes", "0.8", "0.78–0.82", "0.01", "12", "iterations=4"] in [
        line.split() for line in done.stdout.splitlines()
    ]
    assert "Failed: jacobian=sparse: no such kernel" in done.stdout
    document = json.loads(mjbench("show", str(stored), "--json", "-").stdout)
    assert document["schema"] == 2
    (row,) = document["results"]
    assert row["front"][0]["settings"][0]["label"] == "iterations=4"


def test_a_stored_search_is_in_reports_and_tables(stored: Path, tmp_path: Path) -> None:
    page = tmp_path / "report.md"
    done = mjbench("show", str(stored), "--markdown", "-o", str(page))
    assert done.returncode == 0, done.stderr
    assert "| yes | 0.8 | 0.78–0.82 | 0.01 | 12 | iterations=4 |" in page.read_text()
    from mjbench.report import rows

    (row,) = rows.load(stored)
    assert row["settings"] == "iterations=4"
    assert row["ratio.estimate"] == 0.8


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--nbatch", "4"], "--nbatch needs --engine mjx or warp"),
        (["--engine", "mjx", "--only", "free"], "--only works with --engine c"),
    ],
)
def test_options_of_another_engine_are_refused(options: list[str], message: str) -> None:
    done = mjbench("tune", "cartpole", *options)
    assert done.returncode == 2
    assert message in done.stderr
