"""`--resume`: what is finished in a run file stays, what is not is measured again."""

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import click.testing
import pytest
from click.testing import CliRunner
from commands import mjbench
from example_races import invent_comparisons
from paired_examples import decided
from verdict_records import SAME, SLOWER

from mjbench.cli import cli
from mjbench.counts import instructions
from mjbench.counts.instructions import InstructionCounter, ModelCount
from mjbench.paired import verdict
from mjbench.paired.targets import Target
from mjbench.releases import catalogue
from mjbench.releases.catalogue import ReleaseRange
from mjbench.releases.release_names import ReleaseSpec
from mjbench.simulation.models import ModelSource
from mjbench.status import Status

COMPARE = ("compare", "cartpole", "linkage", "--paths", "rollout", "--threads", "2")


pytestmark = pytest.mark.usefixtures("quiet_host")


def invoke(*words: str) -> "click.testing.Result":
    return CliRunner().invoke(cli, list(words))


def test_a_torn_comparison_is_continued_where_it_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    plans = invent_comparisons(monkeypatch)
    assert invoke(*COMPARE).exit_code == 0
    (file,) = Path("results/runs").glob("*.jsonl")
    complete = file.read_text()
    *kept, _race = complete.splitlines(keepends=True)
    file.write_text("".join(kept)[:-20])  # the last path of the second model
    assert len(plans) == 2
    done = invoke(*COMPARE, "--resume", str(file), "--json", "out.json")
    assert done.exit_code == 0, done.output
    assert "the last line was cut short" in done.stderr
    assert len(plans) == 3
    assert file.read_text() == complete
    rows = json.loads(Path("out.json").read_text())["results"]
    assert list(dict.fromkeys(row["model"] for row in rows)) == ["cartpole", "linkage"]
    assert all(row["step_ns"] for row in rows)


def test_a_finished_run_is_shown_and_left_as_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    plans = invent_comparisons(monkeypatch)
    words = (*COMPARE, "--nstep", "20")
    invoke(*words)
    (file,) = Path("results/runs").glob("*.jsonl")
    before = file.read_text()
    done = invoke(*words, "--resume", str(file))
    assert done.exit_code == 0, done.output
    assert len(plans) == 2
    assert "linkage: 10 simulations" in done.stdout
    assert file.read_text() == before
    for other, message in (
        ((*COMPARE, "--nstep", "30"), "nstep 20, and this command 30"),
        (("ab", "pile", "path=rollout"), "the command compare"),
        ((*words, "--json", str(file)), "choose another"),
    ):
        refused = invoke(*other, "--resume", str(file))
        assert refused.exit_code == 2
        assert message in refused.stderr
        assert file.read_text() == before


@pytest.mark.parametrize("name", ["missing.jsonl", "notes.txt", "."])
def test_what_is_no_run_file_cannot_be_continued(tmp_path: Path, name: str) -> None:
    (tmp_path / "notes.txt").write_text("notes\n")
    done = mjbench("ab", "pile", "path=rollout", "--resume", name, cwd=tmp_path)
    assert done.returncode == 2
    assert (tmp_path / "notes.txt").read_text() == "notes\n"


def run_versions(
    monkeypatch: pytest.MonkeyPatch, statuses: Sequence[Status], *words: str
) -> tuple[list[str], Any]:
    """Run `versions` on two models; return the models that were measured, and how it ended."""
    measured: list[str] = []

    def decide(pool: object, baseline: Target, candidate: Target, *others: object) -> Any:
        measured.append(candidate.model.name)
        return decided(baseline, candidate, statuses[len(measured) - 1])

    monkeypatch.setattr(verdict, "decide_pair", decide)
    done = CliRunner().invoke(
        cli, ["versions", "installed", "installed", "cartpole", "linkage", *words]
    )
    return measured, done


def test_verdicts_that_were_interrupted_or_failed_are_measured_again(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    measured, done = run_versions(monkeypatch, [Status.OK, Status.INTERRUPTED])
    assert (measured, done.exit_code) == (["cartpole", "linkage"], 130)
    (file,) = Path("results/runs").glob("*.jsonl")
    measured, done = run_versions(monkeypatch, [Status.FAILED], "--resume", str(file))
    assert (measured, done.exit_code) == (["linkage"], 3)
    measured, done = run_versions(monkeypatch, [Status.OK], "--resume", str(file))
    assert (measured, done.exit_code) == (["linkage"], 0)
    assert "cartpole" in done.stdout
    measured, done = run_versions(monkeypatch, [], "--resume", str(file))
    assert (measured, done.exit_code) == ([], 0)
    assert len(file.read_text().splitlines()) == 3


def test_a_changed_model_is_noticed_also_beside_one_of_the_same_name(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(
        verdict, "decide_pair", lambda pool, *targets: decided(*targets[:2], Status.OK)
    )
    for folder in ("a", "b"):
        Path(folder).mkdir()
        Path(folder, "m.xml").write_text("<mujoco/>")
    words = ["ab", "a/m.xml", "b/m.xml"]
    assert CliRunner().invoke(cli, words).exit_code == 0
    (file,) = Path("results/runs").glob("*.jsonl")
    Path("a/m.xml").write_text("<mujoco ></mujoco>")
    done = CliRunner().invoke(cli, [*words, "--resume", str(file)])
    assert done.exit_code == 2
    assert "m.xml has changed" in done.stderr


def test_a_search_is_continued_after_its_last_measurement(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    versions = "3.2.7", "3.3.0", "3.3.1", "3.3.2", "3.3.3"
    releases = ReleaseRange([ReleaseSpec(version, version) for version in versions])
    monkeypatch.setattr(catalogue, "releases_between", lambda *arguments: releases)
    compared: list[tuple[str, str]] = []
    stops_after = 2

    def log_ratio(baseline: Target, candidate: Target) -> float:
        if len(compared) == stops_after:
            raise KeyboardInterrupt
        pair = baseline.release.version, candidate.release.version
        compared.append(pair)
        return 0.03 if pair[0] < "3.3.1" <= pair[1] else 0.0

    def decide(pool: object, baseline: Target, candidate: Target, *others: object) -> Any:
        return SLOWER if log_ratio(baseline, candidate) > 0 else SAME

    monkeypatch.setattr(verdict, "decide_pair", decide)
    words = ("bisect", "3.2.7", "3.3.3", "cartpole")
    done = invoke(*words)
    assert done.exit_code == 130
    assert "to go on, add --resume" in done.stderr
    assert "The search has not ended" in done.stdout
    (file,) = Path("results/runs").glob("*.jsonl")
    assert "The search has not ended" in invoke("show").stdout
    stops_after = 100
    again = invoke(*words, "--resume", str(file), "--json", "out.json")
    assert again.exit_code == 0, again.stderr
    assert len(compared) == len(set(compared))
    (record,) = json.loads(Path("out.json").read_text())["results"]
    assert [change["version"]["name"] for change in record["changes"]] == ["3.3.1"]
    stored = file.read_text()
    gated = invoke(*words, "--resume", str(file), "--fail-on", "slower")
    assert "3.3.1: slower by 3 %" in gated.stdout
    assert gated.exit_code == 1
    assert file.read_text() == stored


def test_counts_of_instructions_are_continued_with_the_same_work(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    counted: list[tuple[str, str]] = []

    def count(
        counter: InstructionCounter, release: ReleaseSpec, sources: Sequence[ModelSource], _: float
    ) -> Iterator[ModelCount]:
        for source in sources:
            if len(counted) == 3:
                raise KeyboardInterrupt
            counted.append((release.version, source.name))
            yield ModelCount(model=source.name, release=release.version, build=release.key)

    monkeypatch.setattr(instructions, "unavailable", lambda: None)
    monkeypatch.setattr(InstructionCounter, "count", count)
    releases = ("--releases", "3.3.0,3.3.1")
    words = ("profile", "--instructions", "cartpole", "linkage", *releases)
    assert invoke(*words).exit_code == 130
    (file,) = Path("results/runs").glob("*.jsonl")
    counted.clear()
    assert invoke(*words, "--resume", str(file)).exit_code == 0
    assert counted == [("3.3.0", "linkage"), ("3.3.1", "linkage")]
    records = [json.loads(line) for line in file.read_text().splitlines()[1:]]
    assert [(record["release"], record["model"]) for record in records] == [
        *(("3.3.0", "cartpole"), ("3.3.0", "linkage")),
        *(("3.3.1", "cartpole"), ("3.3.1", "linkage")),
    ]
