"""`mjbench tune --engine`: options, models that an engine does not take, and stored searches."""

import json
from pathlib import Path

import pytest
from commands import mjbench

from mjbench.instrument import machine, run_file, runs
from mjbench.paired.records import LaunchRow, Ratio
from mjbench.simulation.accelerated_limits import Precision
from mjbench.simulation.starts import Starts
from mjbench.status import Status
from mjbench.tuning.accelerated_records import (
    EngineAttempt,
    EngineFacts,
    EngineProgram,
    EngineRecommendation,
    EngineTuneRecord,
)
from mjbench.tuning.accelerated_settings import EngineSetting
from mjbench.tuning.distance import Distance, Units
from mjbench.tuning.settings import Edit, Part

PGS = """<mujoco><option solver="PGS"/><worldbody><body>
<joint axis="0 1 0"/><geom type="capsule" fromto="0 0 0 0 0 -1" size="0.1"/>
</body></worldbody></mujoco>"""


def record() -> EngineTuneRecord:
    """Return a search that recommends one setting of two."""
    units = Units(1e-5, 2e-5)
    error = Distance(1e-4, units, units)
    program = EngineProgram(error, 0.5, 12.0, {"naconmax": 1024, "njmax": 64})
    fewer = EngineSetting("iterations", "iterations=4", (Edit(Part.OPTION, "iterations", "4"),))
    sparse = EngineSetting(
        "jacobian", "jacobian=sparse", (Edit(Part.OPTION, "jacobian", "sparse"),)
    )
    samples = LaunchRow(None, None, ["ABBA"], [[1000, 800, 800, 1000]])
    return EngineTuneRecord(
        model="robot",
        engine="warp",
        nbatch=64,
        facts=EngineFacts(
            "cpu", Precision.FLOAT32, 64, 0.5, 31, Starts(0.1, 0.1), error, [fewer, sparse]
        ),
        present=program,
        attempts=[
            EngineAttempt([fewer], Status.OK, program=program, samples=samples),
            EngineAttempt([sparse], Status.FAILED, "no such kernel"),
        ],
        front=[
            EngineRecommendation([fewer], Ratio(0.8, 0.78, 0.82), error, program, [samples] * 4)
        ],
        seconds=100.0,
    )


@pytest.fixture
def stored(tmp_path: Path) -> Path:
    header = runs.RunHeader(runs.SCHEMA, "tune", machine.describe(), {"engine": "warp"})
    file = run_file.RunFile.create(tmp_path, header)
    file.append(record())
    file.close()
    return file.path


def test_a_stored_search_is_printed_again_with_its_document(stored: Path) -> None:
    done = mjbench("show", str(stored))
    assert done.returncode == 0, done.stderr
    assert "robot on Warp: 1.25 times as fast without a larger transfer error" in done.stdout
    assert "0.800 (0.780 to 0.820)" in done.stdout
    assert "Failed: jacobian=sparse: no such kernel" in done.stdout
    document = json.loads(mjbench("show", str(stored), "--json", "-").stdout)
    assert document["results"] == []
    (row,) = document["accelerated"]
    assert row["front"][0]["settings"][0]["label"] == "iterations=4"


def test_a_stored_search_is_in_reports_and_tables(stored: Path, tmp_path: Path) -> None:
    page = tmp_path / "report.md"
    done = mjbench("report", str(stored), "-o", str(page))
    assert done.returncode == 0, done.stderr
    assert "iterations=4 (recommended)" in page.read_text()
    from mjbench.report import rows

    (row,) = rows.load(stored)
    assert row["settings"] == "iterations=4"
    assert row["ratio.estimate"] == 0.8


def test_a_model_that_mjx_does_not_take_is_one_line(tmp_path: Path) -> None:
    pytest.importorskip("mujoco.mjx")
    (tmp_path / "pgs.xml").write_text(PGS)
    done = mjbench(
        *("tune", "pgs.xml", "--engine", "mjx", "--json", "tune.json", "--results", "runs"),
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stderr
    (line,) = [line for line in done.stdout.splitlines() if line.startswith("pgs")]
    assert "unavailable: MJX does not take this model" in line
    (row,) = json.loads((tmp_path / "tune.json").read_text())["accelerated"]
    assert row["status"] == "unavailable"


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
