"""What explains the difference of two counts, and the verdict on instructions."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner
from commands import mjbench
from example_counts import counted, followed_counts

from mjbench.cli import cli
from mjbench.counts import explain, instructions
from mjbench.counts import show as counts
from mjbench.counts.instructions import InstructionCounter, ModelCount
from mjbench.counts.records import ExplainRecord, FunctionDifference
from mjbench.interval import Interval
from mjbench.paired.outcomes import Verdict
from mjbench.paired.records import TargetRow, VerdictRow
from mjbench.releases.release_names import ReleaseSpec
from mjbench.simulation.models import ModelSource
from mjbench.status import Status


def timed(ratio: Interval | None, status: Status = Status.OK, detail: str = "") -> VerdictRow:
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


def explained(
    baseline: ModelCount, candidate: ModelCount, time: VerdictRow | None = None
) -> ExplainRecord:
    return explain.explain_change(baseline, candidate, time)


def summarized(
    baseline: ModelCount, candidate: ModelCount, time: VerdictRow | None = None
) -> list[str]:
    return counts.summary(explained(baseline, candidate, time))


def test_a_step_that_leads_elsewhere_is_changed_work() -> None:
    baseline, here, elsewhere = followed_counts()
    for candidate, is_changed in ((here, False), (elsewhere, True)):
        lines = summarized(baseline, candidate)
        assert any("changed work" in line for line in lines) is is_changed


def test_a_model_that_could_not_be_counted_is_not_explained() -> None:
    crashed = ModelCount(model="m", release="2.0", status=Status.CRASHED)
    assert explained(counted("1.0", a=1000.0), crashed).status is Status.CRASHED


def test_time_that_instructions_do_not_explain_is_pointed_out() -> None:
    baseline, candidate = counted("1.0", a=1000.0), counted("2.0", a=1010.0)
    lines = summarized(baseline, candidate, timed(Interval(1.02, 1.01, 1.03)))
    assert lines[0].startswith("slower, time +2.00 % (+1.00 to +3.00); instructions per step")
    assert len(lines) == 2
    *_, last_line = summarized(baseline, candidate, timed(Interval(1.10, 1.09, 1.11)))
    assert "disagree by 9.0 points" in last_line


def test_an_interval_that_is_unknown_disagrees_with_nothing() -> None:
    lines = summarized(
        counted("1.0", a=1000.0), counted("2.0", a=1010.0), timed(Interval(1.5, None, None))
    )
    assert lines[0].startswith("slower, time +50.00 % (interval unknown); instructions")
    assert len(lines) == 2


def test_cost_that_moved_is_named_with_what_is_left_of_it() -> None:
    count = counted("1.0", a=1000.0)
    moved = [
        FunctionDifference(name=name, old=1.0, new=1.0, difference=by, moved_with=[other])
        for name, by, other in (("f", -900.0, "g"), ("g", 950.0, "f"))
    ]
    row = replace(explained(count, count), functions=moved)
    assert "cost moved between f (-900) and g (+950), together +50" in counts.summary(row)


def test_a_time_that_could_not_be_compared_says_why() -> None:
    count = counted("1.0", a=1000.0)
    lines = summarized(count, count, timed(None, Status.FAILED, "no core"))
    assert lines[2:] == ["time not compared: no core"]


METRIC = ("--metric", "instructions")


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
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(instructions, "unavailable", lambda: None)
    monkeypatch.setattr(InstructionCounter, "count", InventedCounter(1.1).count)
    words = [
        "versions",
        "--explain",
        "installed",
        "installed",
        "cartpole",
        "--skip",
        "times",
        "--json",
    ]
    done = CliRunner().invoke(cli, [*words, str(tmp_path / "out.json")])
    assert done.exit_code == 0, done.stderr
    assert "same work" in done.stdout
    (row,) = json.loads((tmp_path / "out.json").read_text())["results"]
    assert row["instructions_per_step"] == {"old": 1000.0, "new": pytest.approx(1100.0)}
    assert row["stages"]["solver"]["new"] == pytest.approx(1100.0)
    assert [function["name"] for function in row["functions"]] == ["a"]
    assert row["time"] is None


@pytest.mark.parametrize(("factor", "verdict", "code"), [(1.0, "same", 0), (1.02, "slower", 1)])
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


def test_two_models_are_compared_by_their_instructions(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(instructions, "unavailable", lambda: None)
    monkeypatch.setattr(InstructionCounter, "count", InventedCounter(1.02).count)
    words = ("ab", "pile", "cloth", *METRIC, "--fail-on", "slower")
    done = CliRunner().invoke(cli, words)
    assert done.exit_code == 1, done.stderr
    assert "cloth" in done.stdout


def test_instructions_are_of_the_plain_loop() -> None:
    done = mjbench("versions", "2.3.7", "4.0.0", "pile", *METRIC, "--paths", "rollout")
    assert done.returncode == 2
    assert "counts python_loop only" in done.stderr
