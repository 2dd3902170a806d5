"""`mjbench show --against`: two run files or run sets of `compare`."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result
from commands import ROOT, check_document, mjbench
from example_races import compared, raced
from example_records import measurement, model_record
from set_files import MACHINE, labelled, run_file, set_of
from verdict_records import SAME

from mjbench.cli import cli
from mjbench.host import machine
from mjbench.host.machine import Machine
from mjbench.store import runs
from mjbench.store.run_writer import RunFile

RUNS = ROOT / "results/runs"


def stored_run(folder: Path, jax: str, seconds: float) -> str:
    versions = {"jax": jax}
    file = RunFile.create(
        folder,
        runs.RunHeader(runs.SCHEMA, "compare", replace(machine.describe(), versions=versions), {}),
    )
    file.append(model_record())
    file.append(measurement(path="mjx", precision="float32", device="cpu", samples_s=[seconds] * 9))
    file.close()
    return str(file.path)


def test_diff_compares_run_files_and_refuses_other_versions_of_jax(tmp_path: Path) -> None:
    old = stored_run(tmp_path / "old", "1", 1.0)
    new = stored_run(tmp_path / "new", "2", 1.5)
    refused = mjbench("show", new, "--against", old)
    assert refused.returncode == 2
    assert "they differ in jax (2, 1)" in refused.stdout
    compared = mjbench("show", new, "--against", old, "--across", "--json", "-")
    assert compared.returncode == 0, compared.stderr
    assert json.loads(compared.stdout)["results"][0]["ratio"]["estimate"] == pytest.approx(1.5)


def test_run_files_with_nothing_in_common_are_bad_input(tmp_path: Path) -> None:
    old = stored_run(tmp_path, "1", 1.0)
    done = mjbench("show", "--against", old, str(RUNS / "reference-selfcheck-quiet.jsonl"))
    assert done.returncode == 2
    assert "no timed row" in done.stderr


# sets


def timed(folder: Path, machine: Machine, seconds: float, model: str = "m") -> Path:
    """Return a run file of `compare` with one path."""
    record = measurement(model=model, samples_s=[seconds] * 9)
    return run_file(folder, machine, model_record(model=model), record)


def diff(folder: Path, old: list[Path], new: list[Path]) -> Result:
    """Return how sets of run files compare; what is printed, and the rows in `out.json`."""
    (folder / "old.jsonl").unlink(missing_ok=True)
    (folder / "new.jsonl").unlink(missing_ok=True)
    words = [set_of(folder / "new.jsonl", new), "--against", set_of(folder / "old.jsonl", old)]
    done = CliRunner().invoke(cli, ["show", *map(str, words), "--json", str(folder / "out.json")])
    if done.exit_code == 0:
        check_document("diff", (folder / "out.json").read_text())
    return done


def rows(folder: Path) -> list[dict[str, Any]]:
    result: list[dict[str, Any]] = json.loads((folder / "out.json").read_text())["results"]
    return result


def test_each_machine_of_a_set_is_compared_with_itself(tmp_path: Path) -> None:
    old = [timed(tmp_path, labelled("a"), 1.0), timed(tmp_path, labelled("b"), 1.0)]
    new = [timed(tmp_path, labelled("b"), 2.0), timed(tmp_path, labelled("a"), 1.5)]
    done = diff(tmp_path, old, new)
    assert done.exit_code == 0, done.output
    ratios = {row["machine"]: row["ratio"]["estimate"] for row in rows(tmp_path)}
    assert ratios == {"a": pytest.approx(1.5), "b": pytest.approx(2.0)}
    _, first, *lines = done.output.splitlines()
    assert first == "a, m: OLD: timed by an earlier version of mjbench"
    assert lines[3] == "Of 2 rows: 2 undecided"
    assert lines[4].split()[:2] == ["machine", "model"]


def test_a_machine_that_one_set_lacks_is_a_row_that_says_so(tmp_path: Path) -> None:
    both, gone, new = (timed(tmp_path, labelled(name), 1.0) for name in "abc")
    assert diff(tmp_path, [both, gone], [both, new]).exit_code == 0
    details = {row["machine"]: (row["status"], row["detail"]) for row in rows(tmp_path)}
    assert details == {
        "a": ("ok", ""),
        "b": ("unavailable", "not in NEW"),
        "c": ("unavailable", "not in OLD"),
    }


def test_without_a_machine_in_common_the_rows_say_why_and_it_is_bad_input(tmp_path: Path) -> None:
    old, new = (timed(tmp_path, labelled(name), 1.0) for name in "ab")
    done = diff(tmp_path, [old], [new])
    assert done.exit_code == 2
    assert "not in NEW" in done.stdout
    assert "no timed row of `compare` in common" in done.stderr


def test_hosts_are_paired_where_both_are_known_and_kinds_where_they_are_not(
    tmp_path: Path,
) -> None:
    a, b = (replace(MACHINE, host=host) for host in "12")
    known = [timed(tmp_path, a, 1.0), timed(tmp_path, b, 1.0)]
    assert diff(tmp_path, known, [timed(tmp_path, b, 1.5)]).exit_code == 0
    paired = [row for row in rows(tmp_path) if row["ratio"]]
    assert [row["machine"] for row in paired] == ["AMD EPYC 7763 B"]
    older = timed(tmp_path, MACHINE, 1.0)
    assert diff(tmp_path, [older], [timed(tmp_path, a, 1.5)]).exit_code == 0
    assert [row["status"] for row in rows(tmp_path)] == ["ok"]
    # it may be either of two
    done = diff(tmp_path, [older], known)
    assert done.exit_code == 2
    assert "it may be one of 2 of this kind in NEW: its host is unknown" in done.stdout


def test_what_was_measured_twice_is_not_averaged(tmp_path: Path) -> None:
    twice = [timed(tmp_path, labelled("a"), seconds) for seconds in (1.0, 2.0)]
    done = diff(tmp_path, twice, [timed(tmp_path, labelled("a"), 1.5)])
    assert done.exit_code == 2
    assert "OLD has it 2 times: give the run file you mean" in done.stdout


def test_runs_of_other_commands_in_a_set_are_left_out_and_counted(tmp_path: Path) -> None:
    compared = timed(tmp_path, labelled("a"), 1.0)
    verdict = run_file(tmp_path, labelled("a"), SAME, command="versions")
    done = diff(tmp_path, [compared, verdict], [compared])
    assert done.exit_code == 0
    assert "left out: runs of other commands than compare (1 of versions)" in done.stderr
    assert len(rows(tmp_path)) == 1


def test_a_run_file_is_compared_with_its_machine_in_a_set(tmp_path: Path) -> None:
    file = timed(tmp_path, labelled("a"), 1.0)
    others = [timed(tmp_path, labelled(name), 1.5) for name in "ab"]
    words = ["show", str(set_of(tmp_path / "new.jsonl", others)), "--against", str(file)]
    done = CliRunner().invoke(cli, words)
    assert done.exit_code == 0
    assert "1.500" in done.stdout
    assert "not in OLD" in done.stdout


# what fails a command


def raced_run(folder: Path, factor: float, cores: float = 2.0) -> Path:
    """Return a run file of a comparison in which every step takes `factor` microseconds or less."""
    record = raced(steps=round(1000 / factor), cores=cores)
    return run_file(folder, labelled("a"), *compared(record))


@pytest.mark.parametrize(
    ("factor", "fail_on", "verdict", "code"),
    [
        (1.2, "slower", "slower", 1),
        (1.2, "faster", "slower", 0),
        (0.8, "slower", "faster", 0),
        (0.8, "faster", "faster", 1),
        (1.02, "slower,faster", "same", 0),
        (1.05, "slower", "inconclusive", 3),
        (1.05, "inconclusive", "inconclusive", 1),
        (1.05, "slower,--allow-inconclusive", "inconclusive", 0),
    ],
)
def test_what_is_certainly_slower_than_an_earlier_run_fails_in_ci(
    tmp_path: Path, factor: float, fail_on: str, verdict: str, code: int
) -> None:
    old, new = raced_run(tmp_path / "old", 1.0), raced_run(tmp_path / "new", factor)
    findings, _, flag = fail_on.partition(",--")
    words = ["show", str(new), "--against", str(old), "--fail-on", findings]
    words += [f"--{flag}"] * bool(flag) + ["--json", str(tmp_path / "out.json")]
    done = CliRunner().invoke(cli, words)
    verdicts = [row["verdict"] for row in rows(tmp_path)]
    assert set(verdicts) == {verdict, None}  # the slow paths leave the race early
    assert done.exit_code == code, done.output
    assert done.stdout.splitlines()[1].startswith(f"Of 4 rows: {4 - verdicts.count(None)} ")


@pytest.mark.parametrize(("finding", "code"), [("slower", 1), ("faster", 0)])
def test_a_stored_verdict_fails_in_ci(finding: str, code: int) -> None:
    run = RUNS / "reference-story-versions.jsonl"
    assert CliRunner().invoke(cli, ["show", str(run), "--fail-on", finding]).exit_code == code


def test_of_several_runs_the_one_that_decides_is_named() -> None:
    runs = [str(RUNS / f"reference-{name}.jsonl") for name in ("story-versions", "story-env")]
    done = CliRunner().invoke(cli, ["show", *runs, "--fail-on", "slower"])
    assert done.exit_code == 1
    assert "exit code 1: mjbench versions" in done.stderr


def test_a_disturbed_run_decides_nothing(tmp_path: Path) -> None:
    old, new = raced_run(tmp_path / "old", 1.0), raced_run(tmp_path / "new", 2.0, cores=0.5)
    words = ["show", str(new), "--against", str(old), "--fail-on", "slower"]
    done = CliRunner().invoke(cli, words)
    assert done.exit_code == 3
    assert "undecided" in done.stdout


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--fail-on", "slower", f"{RUNS}/reference-mujoco-4.0.0.jsonl"], "add --against OLD"),
        (["--fail-on", "slower", "--html"], "leave out the format"),
        (["--html", "--against", "old"], "leave out --code and formats"),
        (["-o", "x"], "add --html, --markdown or --format"),
        (["--markdown", "--json", "-"], "leave out the format"),
        (["a", "b", "--against", "old"], "compares one RUN"),
    ],
)
def test_options_of_show_that_do_not_go_together_are_refused(
    words: list[str], message: str
) -> None:
    done = mjbench("show", *words)
    assert done.returncode == 2
    assert message in done.stderr
