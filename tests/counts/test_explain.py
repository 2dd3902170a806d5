"""What explains the difference of two counts, and the verdict on instructions."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from commands import mjbench

from mjbench.cli import cli
from mjbench.counts import explain, instructions
from mjbench.counts.instructions import InstructionCounter, ModelCount
from mjbench.counts.records import FunctionCount
from mjbench.instrument.runs import to_json
from mjbench.paired.outcomes import Metric, Verdict
from mjbench.paired.records import Ratio, TargetRow, VerdictRow
from mjbench.releases.installs import ReleaseSpec
from mjbench.simulation.models import ModelSource
from mjbench.simulation.work import Work
from mjbench.simulation.work_check import Followed
from mjbench.status import Status


def counted(release: str, **functions: float) -> ModelCount:
    return ModelCount(
        model="pile",
        release=release,
        instructions_per_step=sum(functions.values()),
        outside_per_step=1.0,
        functions=[FunctionCount(name, cost, cost) for name, cost in functions.items()],
        stages={"solver": sum(functions.values())},
        work=Work(contacts=4.0, constraints=16.0, solver_iterations=3.0),
    )


def timed(ratio: Ratio | None, status: Status = Status.OK, detail: str = "") -> VerdictRow:
    target = TargetRow("1.0", "pile", "python_loop", {}, {})
    return VerdictRow(
        model="pile",
        path="python_loop",
        old="1.0",
        new="2.0",
        sides=[target, replace(target, release="2.0")],
        status=status,
        detail=detail,
        ratio=ratio,
        verdict=Verdict.SLOWER if ratio else None,
    )


def test_changes_are_sorted_by_contribution_with_new_and_gone_functions() -> None:
    baseline = counted("1.0", a=100.0, b=50.0, gone=30.0)
    candidate = counted("2.0", a=90.0, b=50.0, fresh=200.0)
    functions = explain.function_differences(baseline, candidate)
    assert [(f.name, f.difference, f.occurrence) for f in functions] == [
        ("fresh", 200.0, "new"),
        ("gone", -30.0, "gone"),
        ("a", -10.0, ""),
    ]
    assert sum(f.difference for f in functions) == (candidate.instructions_per_step or 0) - 180.0


def test_the_json_row_has_both_releases_under_old_and_new() -> None:
    row = explain.explain_row(counted("1.0", a=100.0), counted("2.0", a=90.0), None)
    work = {"contacts": 4.0, "constraints": 16.0, "solver_iterations": 3.0}
    assert to_json(row) == {
        "model": "pile",
        "old": "1.0",
        "new": "2.0",
        "status": "ok",
        "instructions_per_step": {"old": 100.0, "new": 90.0},
        "outside_per_step": {"old": 1.0, "new": 1.0},
        "work": {"old": work, "new": work},
        "stages": {"solver": {"old": 100.0, "new": 90.0}},
        "functions": [{"name": "a", "old": 100.0, "new": 90.0, "difference": -10.0}],
        "time": None,
    }


@pytest.mark.parametrize(
    ("candidate", "expected"),
    [
        (1004.0, Verdict.SAME),
        (1005.0, Verdict.SLOWER),
        (1100.0, Verdict.SLOWER),
        (900.0, Verdict.FASTER),
    ],
)
def test_a_verdict_on_instructions_is_exact(candidate: float, expected: Verdict) -> None:
    row = explain.verdict_row(counted("1.0", a=1000.0), counted("2.0", a=candidate), 0.005)
    assert row.metric is Metric.INSTRUCTIONS
    assert row.verdict is expected
    assert row.ratio is not None
    assert row.ratio.low is not None
    assert row.ratio.high is not None
    assert row.ratio.low < candidate / 1000 < row.ratio.high
    assert row.changed_work is False


def test_a_step_that_leads_elsewhere_is_changed_work() -> None:
    here, elsewhere = {"qpos": np.array([[[1.0]]])}, {"qpos": np.array([[[1.0 + 1e-6]]])}
    healthy = np.ones(1, dtype=bool)
    baseline = replace(
        counted("1.0", a=1000.0), healthy=healthy, followed=Followed([0], here, here)
    )
    for after, is_changed in ((here, False), (elsewhere, True)):
        candidate = replace(
            counted("2.0", a=1000.0), healthy=healthy, followed=Followed([0], here, after)
        )
        assert explain.verdict_row(baseline, candidate, 0.005).changed_work is is_changed
        lines = explain.summary(baseline, candidate, None)
        assert any("changed work" in line for line in lines) is is_changed


def test_a_model_that_could_not_be_counted_has_no_verdict() -> None:
    crashed = ModelCount(
        model="m", release="2.0", status=Status.CRASHED, detail="killed by signal 11"
    )
    row = explain.verdict_row(counted("1.0", a=1000.0), crashed, 0.005)
    assert (row.status, row.verdict, row.ratio, row.work) == (Status.CRASHED, None, None, None)
    assert row.detail == "MuJoCo 2.0: killed by signal 11"
    assert explain.explain_row(counted("1.0", a=1000.0), crashed, None).status is Status.CRASHED


def test_time_that_instructions_do_not_explain_is_pointed_out() -> None:
    baseline, candidate = counted("1.0", a=1000.0), counted("2.0", a=1010.0)
    explained = explain.summary(baseline, candidate, timed(Ratio(1.02, 1.01, 1.03)))
    assert explained[2:] == ["time +2.00 % (+1.00 to +3.00), slower"]
    *_, last_line = explain.summary(baseline, candidate, timed(Ratio(1.10, 1.09, 1.11)))
    assert "disagree by 9.0 points" in last_line


def test_an_interval_that_is_unknown_disagrees_with_nothing() -> None:
    lines = explain.summary(
        counted("1.0", a=1000.0), counted("2.0", a=1010.0), timed(Ratio(1.5, None, None))
    )
    assert lines[2:] == ["time +50.00 % (interval unknown), slower"]


def test_a_time_that_could_not_be_compared_says_why() -> None:
    count = counted("1.0", a=1000.0)
    lines = explain.summary(count, count, timed(None, Status.FAILED, "no core"))
    assert lines[2:] == ["time not compared: no core"]


class InventedCounter:
    """Counts without Callgrind: the second release takes `factor` as many instructions."""

    def __init__(self, factor: float):
        self.factor, self.calls = factor, 0

    def count(
        self, release: ReleaseSpec, sources: Sequence[ModelSource], limit_s: float = 0.0
    ) -> list[ModelCount]:
        self.calls += 1
        cost = 1000.0 * (self.factor if self.calls == 2 else 1.0)
        count = replace(counted(release.version, a=cost), build=release.key)
        return [replace(count, model=source.name) for source in sources]


def test_the_command_compares_functions_and_writes_json(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(instructions, "unavailable", lambda: None)
    monkeypatch.setattr(InstructionCounter, "count", InventedCounter(1.1).count)
    words = ["explain", "installed", "installed", "cartpole", "--no-clock", "--json"]
    done = CliRunner().invoke(cli, [*words, str(tmp_path / "out.json")])
    assert done.exit_code == 0, done.stderr
    assert "same work" in done.stdout
    (row,) = json.loads((tmp_path / "out.json").read_text())["results"]
    assert row["instructions_per_step"] == {"old": 1000.0, "new": pytest.approx(1100.0)}
    assert row["stages"]["solver"]["new"] == pytest.approx(1100.0)
    assert [function["name"] for function in row["functions"]] == ["a"]
    assert row["time"] is None


@pytest.mark.parametrize(
    ("factor", "verdict", "code"), [(1.0, "same", 0), (1.02, "slower", 1), (0.9, "faster", 0)]
)
def test_instructions_can_gate_an_upgrade(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, factor: float, verdict: str, code: int
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(instructions, "unavailable", lambda: None)
    counter = InventedCounter(factor)
    monkeypatch.setattr(InstructionCounter, "count", counter.count)
    words = [
        *("versions", "installed", "installed", "cartpole", "--metric", "instructions"),
        *("--fail-on", "slower,changed-work", "--min-effect", "0.5%", "--json", "out.json"),
    ]
    done = CliRunner().invoke(cli, words)
    assert done.exit_code == code, done.stderr
    (row,) = json.loads((tmp_path / "out.json").read_text())["results"]
    assert (row["metric"], row["verdict"], row["changed_work"]) == ("instructions", verdict, False)
    assert "same work" in done.stdout
    assert "same work" in CliRunner().invoke(cli, ["show"]).stdout
    (file,) = (tmp_path / "results/runs").glob("*.jsonl")
    again = CliRunner().invoke(cli, [*words, "--resume", str(file)])
    assert (again.exit_code, counter.calls) == (code, 2)


def test_instructions_are_of_the_plain_loop() -> None:
    done = mjbench("versions", "2.3.7", "4.0.0", "--metric", "instructions", "--paths", "rollout")
    assert done.returncode == 2
    assert "counts python_loop only" in done.stderr
