"""What explains the difference of two counts, and the verdict on instructions."""

import json
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner
from commands import mjbench
from example_counts import counted, followed_counts

from mjbench.cli import cli
from mjbench.counts import explain, instructions
from mjbench.counts import show as counts
from mjbench.counts.explain import (
    function_differences,
    largest_differences,
    moved_cost,
    moved_groups,
)
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


def test_functions_are_sorted_by_contribution() -> None:
    baseline = counted("1.0", a=100.0, b=50.0, left=30.0)
    candidate = counted("2.0", a=90.0, b=50.0, fresh=200.0)
    functions = function_differences(baseline, candidate)
    assert [(f.name, f.old, f.new, f.difference) for f in functions] == [
        ("fresh", None, 200.0, 200.0),
        ("left", 30.0, None, -30.0),
        ("a", 100.0, 90.0, -10.0),
        ("b", 50.0, 50.0, 0.0),
    ]
    assert [net.names for net in largest_differences(functions, 9)] == [["fresh"], ["left"], ["a"]]
    assert len(largest_differences(functions, 1)) == 1


def test_functions_without_names_are_one_for_each_library() -> None:
    baseline, candidate = (
        replace(
            counted(release, **{address: 300.0, "0x9": 60.0}),
            libraries=dict.fromkeys((address, "0x9"), "/a/_structs.cpython.so"),
        )
        for release, address in (("1.0", "0x10"), ("2.0", "0x20"))
    )
    (function,) = function_differences(baseline, candidate)
    assert (function.name, function.old, function.new) == ("_structs (no symbols)", 360.0, 360.0)


def test_moved_cost_is_found_by_the_calls_of_either_release() -> None:
    baseline = counted("1.0", frozenset({("f", "callee")}), f=100.0, callee=900.0)
    functions = function_differences(baseline, counted("2.0", f=1000.0))
    assert {f.name: f.moved_with for f in functions} == {"f": ["callee"], "callee": ["f"]}


def test_a_function_names_those_that_took_over_its_cost_and_not_the_others_that_gave_it_up() -> (
    None
):
    calls = frozenset({("f", "callee"), ("g", "callee"), ("h", "other")})
    baseline = counted("1.0", f=600.0, g=500.0, h=300.0)
    candidate = counted("2.0", calls, f=1.0, g=1.0, callee=1100.0, h=1.0, other=300.0)
    functions = function_differences(baseline, candidate)
    assert {f.name: f.moved_with for f in functions} == {
        "callee": ["f", "g"],
        "f": ["callee"],
        "g": ["callee"],
        "h": ["other"],
        "other": ["h"],
    }
    groups = [[f.name for f in group] for group in moved_groups(functions)]
    assert groups == [["callee", "f", "g"], ["other", "h"]]


def moved(
    differences: dict[str, float],
    calls: Iterable[tuple[str, str]],
    min_cost: float = 1.0,
    rest: float = 10.0,
) -> list[set[str]]:
    """Return the groups, for functions that cost `rest` in the release in which they cost less."""
    functions = {
        name: FunctionDifference(
            name=name, old=rest + max(0.0, -by), new=rest + max(0.0, by), difference=by
        )
        for name, by in differences.items()
    }
    return [set(group) for group in moved_cost(functions, calls, min_cost)]


def test_a_callee_that_is_inlined_moves_its_cost_to_the_caller() -> None:
    calls = [("caller", "callee"), ("caller", "other")]
    differences = {"caller": 95.0, "callee": -100.0, "other": 5.0}
    assert moved(differences, calls) == [{"caller", "callee"}]


def test_several_callees_may_move_to_one_caller_and_one_to_several() -> None:
    several = {"f": 100.0, "g": -60.0, "h": -41.0}
    assert moved(several, [("f", "g"), ("f", "h")]) == [{"f", "g", "h"}]
    assert moved(several, [("g", "f"), ("h", "f")]) == [{"f", "g", "h"}]


def test_nothing_moves_without_a_call() -> None:
    differences = {"f": 100.0, "g": -100.0}
    assert moved(differences, []) == []


def test_a_function_that_changed_in_the_same_direction_has_no_part_in_a_move() -> None:
    differences = {"f": 100.0, "g": -110.0, "h": 10.0}
    groups = moved(differences, [("g", "f"), ("g", "h"), ("f", "h")])
    assert groups == [{"f", "g", "h"}]  # h as a part of what g gave up
    assert moved(differences, [("g", "f"), ("f", "h")]) == [{"f", "g"}]


def test_cost_that_grew_or_that_is_small_did_not_move() -> None:
    calls = [("f", "g")]
    assert moved({"f": 100.0, "g": -50.0}, calls) == []
    assert moved({"f": 100.0, "g": 100.0}, calls) == []
    assert moved({"f": 100.0, "g": -100.0}, calls, min_cost=101.0) == []


def test_a_callee_that_changed_a_little_was_not_inlined() -> None:
    differences, calls = {"f": 100.0, "g": -100.0}, [("f", "g")]
    assert moved(differences, calls, rest=300.0) == [{"f", "g"}]
    assert moved(differences, calls, rest=301.0) == []
