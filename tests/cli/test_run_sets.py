"""Run sets where run files are read otherwise: `show`, exports, `mjbench.load`."""

import csv
import json
from pathlib import Path
from xml.etree import ElementTree

import pytest
from click.testing import CliRunner, Result
from commands import check_document
from example_records import measurement, model_record
from hypothesis import given, settings
from hypothesis import strategies as st
from set_files import labelled, run_file, section_of, set_of
from verdict_records import FAILED, OPEN, SAME, SLOWER, of_model

import mjbench
from mjbench.cli import cli
from mjbench.store.run_set import RunSetFile

COMPARED = (
    model_record(),
    measurement(samples_s=[0.01, 0.011, 0.012]),
    measurement(path="rollout", options={"threads": 2}, samples_s=[0.005, 0.006, 0.005]),
)


def command(*words: object) -> Result:
    return CliRunner().invoke(cli, [str(word) for word in words])


def mixed(folder: Path) -> Path:
    """Return a set of two machines, with verdicts and a comparison of each."""
    files = [
        run_file(folder, labelled(name), *records, command=name_of, began=f"2026-01-0{day}")
        for day, (name, name_of, records) in enumerate(
            [
                ("a", "versions", (SLOWER, of_model(OPEN, "n"))),
                ("b", "versions", (SAME, of_model(FAILED, "n"))),
                ("a", "compare", COMPARED),
                ("b", "compare", COMPARED),
            ],
            1,
        )
    ]
    return set_of(folder / "set.jsonl", files)


# show


def test_a_set_is_shown_side_by_side_and_then_run_by_run(tmp_path: Path) -> None:
    done = command("show", mixed(tmp_path), "--json", tmp_path / "out.json")
    assert done.exit_code == 0, done.output
    lines = done.stdout.splitlines()
    assert lines[1].startswith("4 verdicts on 2 machines, decided together")
    assert ["comparison", "a", "b"] in [line.split() for line in lines]
    assert any("slower on 1 of 2 machines, same on 1 (b)" in line for line in lines)
    runs = [line.strip("─ ") for line in lines if line.startswith("─")]
    assert runs == [
        "Run 1 of 4: versions on a",
        "Run 2 of 4: versions on b",
        "Run 3 of 4: compare on a",
        "Run 4 of 4: compare on b",
    ]
    assert sum("rollout" in line and "threads=2" in line for line in lines) >= 2


def test_the_document_of_a_set_has_what_machines_show_side_by_side(tmp_path: Path) -> None:
    assert command("show", mixed(tmp_path), "--json", tmp_path / "out.json").exit_code == 0
    text = (tmp_path / "out.json").read_text()
    check_document("show-run-set", text)
    document = json.loads(text)
    assert [run["name"] for run in document["runs"]] == ["a", "b", "a", "b"]
    assert document["verdicts"]["machines"] == ["a", "b"]
    first, second = document["verdicts"]["comparisons"]
    assert [m["outcome"] for m in first["machines"]] == ["slower", "same"]
    assert [m["outcome"] for m in second["machines"]] == ["undecided", "undecided"]
    assert {row["question"]["loop"] for row in document["advice"]} == {"open", "closed"}


def test_of_very_many_runs_there_is_a_list(tmp_path: Path) -> None:
    files = [run_file(tmp_path, labelled(f"m{n}"), SAME) for n in range(21)]
    done = command("show", set_of(tmp_path / "set.jsonl", files))
    assert done.exit_code == 0
    assert "21 runs: only listed" in done.stderr
    assert "Run 1 of" not in done.stdout


def test_a_set_of_one_machine_has_nothing_side_by_side(tmp_path: Path) -> None:
    files = [run_file(tmp_path, labelled("a"), verdict) for verdict in (SAME, SLOWER)]
    done = command("show", set_of(tmp_path / "set.jsonl", files))
    assert done.exit_code == 0
    assert "decided together" not in done.stdout
    assert "Run 2 of 2" in done.stdout


def test_an_empty_set_is_shown_and_reported(tmp_path: Path) -> None:
    path = set_of(tmp_path / "set.jsonl", [])
    assert command("show", path).exit_code == 0
    done = command("show", path, "--markdown")
    assert done.exit_code == 0, done.output
    assert "Nothing was measured." in done.stdout
    assert mjbench.load(path) == []


def test_the_newest_file_may_be_a_set(tmp_path: Path) -> None:
    mixed(tmp_path / "sets")
    done = command("show", "--results", tmp_path / "sets")
    assert "Run 4 of 4" in done.stdout


# tables


def test_rows_of_a_set_say_which_machine_they_are_of(tmp_path: Path) -> None:
    file = RunSetFile.open(mixed(tmp_path))
    run = run_file(tmp_path, labelled("c"), SAME, began="2026-01-05")
    file.append(section_of(run, cell="a cell"))
    file.close()
    rows = mjbench.load(file.path)
    assert list(rows[0])[:3] == ["machine", "cell", "began"]
    assert [row["machine"] for row in rows] == [*"aabbaabb", "c"]
    assert (rows[-1]["cell"], rows[-1]["began"]) == ("a cell", "2026-01-05")
    assert len({tuple(row) for row in rows}) == 1
    done = command("show", file.path, "--format", "csv")
    lines = list(csv.DictReader(done.stdout.splitlines()))
    assert [line["machine"] for line in lines] == [row["machine"] for row in rows]


def test_rows_of_a_run_file_are_as_before(tmp_path: Path) -> None:
    (row,) = mjbench.load(run_file(tmp_path, labelled("a"), SAME))
    assert next(iter(row)) == "model"


@pytest.mark.parametrize("form", ["github-action-benchmark", "bencher", "otava"])
def test_metrics_of_a_set_begin_with_the_machine(tmp_path: Path, form: str) -> None:
    done = command("show", mixed(tmp_path), "--format", form)
    assert done.exit_code == 0, done.output
    for machine in "ab":
        assert f"{machine}: m: 1.0.0" in done.stdout
    if form == "otava":
        assert done.stdout.splitlines()[1].startswith("2026-01-04,")


def test_a_metric_that_was_measured_twice_is_refused_and_not_averaged(tmp_path: Path) -> None:
    files = [run_file(tmp_path, labelled("a"), verdict) for verdict in (SAME, SLOWER)]
    done = command("show", set_of(tmp_path / "s.jsonl", files), "--format", "bencher")
    assert done.exit_code == 2
    assert "m: 1.0.0 → 2.0.0 was measured 2 times" in done.stderr


def test_junit_decides_all_machines_together(tmp_path: Path) -> None:
    weak = of_model(SLOWER, "m", e_slower=150.0)
    files = [run_file(tmp_path, labelled(name), weak) for name in "a"]
    files += [run_file(tmp_path, labelled("b"), SAME, of_model(FAILED, "n"))]
    done = command("show", set_of(tmp_path / "set.jsonl", files), "--format", "junit")
    suite = ElementTree.fromstring(done.stdout)
    assert [suite.get(name) for name in ("tests", "failures", "errors", "skipped")] == [
        *("3", "0", "1", "1")
    ]
    skipped = suite.find("testcase/skipped")
    assert skipped is not None
    assert "slower if judged alone" in str(skipped.get("message"))


# damaged sets


@settings(max_examples=60, deadline=None)
@given(cut=st.floats(0, 1), at=st.floats(0, 1), inserted=st.binary(max_size=8))
def test_a_set_of_other_bytes_is_read_or_refused(
    tmp_path_factory: pytest.TempPathFactory, cut: float, at: float, inserted: bytes
) -> None:
    folder = tmp_path_factory.mktemp("sets")
    path = mixed(folder)
    content = path.read_bytes()
    place = int(at * len(content))
    damaged = content[:place] + inserted + content[place + len(inserted) :]
    path.write_bytes(damaged[: int(cut * len(content))])
    for words in (["show", path], ["show", path, "--against", path]):
        done = command(*words)
        assert done.exit_code in (0, 2), (done.exit_code, done.stderr)
        assert "unexpected" not in done.stderr
        assert done.stderr.count("\n") <= 2, done.stderr
