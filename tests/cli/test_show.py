"""`mjbench show` of several run files: what machines answer, and each run after it."""

import json
import os
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from example_races import compared, raced
from set_files import labelled, run_file
from verdict_records import OPEN, SAME, SLOWER, of_model

from mjbench.cli import cli
from mjbench.host.disturbance import Disturbance


def show(*words: object) -> Result:
    return CliRunner().invoke(cli, ["show", *map(str, words)])


@pytest.fixture
def files(tmp_path: Path) -> list[Path]:
    """Return runs of two machines, with verdicts and a comparison of each."""
    return [
        run_file(tmp_path, labelled(name), *records, command=command)
        for name, command, records in [
            ("a", "versions", (SLOWER, of_model(OPEN, "n"))),
            ("b", "versions", (SAME, of_model(OPEN, "n"))),
            ("a", "compare", compared(raced())),
            ("b", "compare", compared(raced())),
        ]
    ]


def test_machines_are_shown_side_by_side_and_then_run_by_run(files: list[Path]) -> None:
    done = show(*files)
    assert done.exit_code == 0, done.output
    lines = done.stdout.splitlines()
    assert lines[1].startswith("All 4 together: slower in 1 (m)")
    assert ["question", "a", "b"] in [line.split() for line in lines]
    assert any("slower on 1 of 2 machines, same on b" in line for line in lines)
    runs = [line.strip("─ ") for line in lines if line.startswith("─")]
    assert runs == [
        "Run 1 of 4: versions on a",
        "Run 2 of 4: versions on b",
        "Run 3 of 4: compare on a",
        "Run 4 of 4: compare on b",
    ]


def test_the_document_has_what_machines_answer(files: list[Path]) -> None:
    done = show(*files, "--json", "-")
    assert done.exit_code == 0, done.output
    document = json.loads(done.stdout)
    assert [run["name"] for run in document["runs"]] == ["a", "b", "a", "b"]
    verdicts = [(each["model"], each["machine"], each["verdict"]) for each in document["results"]]
    assert verdicts[:4] == [
        ("m", "a", "slower"),
        ("n", "a", None),
        ("m", "b", "same"),
        ("n", "b", None),
    ]
    assert {each["question"].rpartition(", ")[2] for each in document["results"][4:]} == {
        *("open loop", "closed loop")
    }


def test_three_runs_of_one_machine_are_shown_one_after_the_other(tmp_path: Path) -> None:
    done = show(*(run_file(tmp_path, labelled("a"), each) for each in (SAME, SLOWER, SAME)))
    assert done.exit_code == 0
    assert "together" not in done.stdout
    assert "Run 3 of 3" in done.stdout


def test_the_number_of_a_stored_run_stands_for_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for age_s, verdict in enumerate((SLOWER, SAME)):
        file = run_file(tmp_path / "results/runs", labelled("a"), verdict, command="versions")
        os.utime(file, (1e9 - age_s, 1e9 - age_s))
    assert show("-1").stdout == show().stdout
    assert "slower" in show("-1").stdout
    assert "slower" not in show("-2").stdout
    assert show("-2", "-1").exit_code == 0
    done = show("-3")
    assert done.exit_code == 2
    assert "-3: results/runs has 2 run files; `mjbench show --list` lists them" in done.stderr


def test_stored_runs_are_listed_newest_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "results/runs"
    records = [[SAME], [SLOWER, Disturbance([], 0.2)]]
    for age_s, each in enumerate(records):
        file = run_file(folder, labelled("a"), *each, command="versions", began="2026-11-29T03:04")
        os.utime(file, (1e9 - age_s, 1e9 - age_s))
    (folder / "broken.jsonl").write_text("1\n2\n")
    os.utime(folder / "broken.jsonl", (1e9 - 9, 1e9 - 9))
    done = show("--list")
    assert done.exit_code == 0
    _, first, second = (line.split() for line in done.stdout.splitlines())
    began = ["2026-11-29", "03:04"]
    assert first == ["-1", *began, "versions", "'a", "model'", "m", "a", "1"]
    assert second == ["-2", *began, "versions", "'a", "model'", "m", "a", "1", "yes"]
    assert "broken.jsonl" in done.stderr
    assert show("--list", "--csv", "-").stdout.count("\n") == 3
    assert "--list takes no RUN" in show("--list", file).stderr


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--across"], "--across compares two RUNs of one kind"),
        (["--csv", "-"], "--csv takes one RUN"),
    ],
)
def test_what_is_of_one_run_is_refused_for_several(
    files: list[Path], words: list[str], message: str
) -> None:
    done = show(*files, *words)
    assert done.exit_code == 2
    assert message in done.stderr


def test_a_file_that_is_given_twice_is_shown_once(tmp_path: Path) -> None:
    file = run_file(tmp_path, labelled("a"), SAME)
    assert show(file, file).stdout == show(file).stdout
