"""`mjbench show OLD NEW`: two run files of one kind."""

import json
from pathlib import Path

import pytest
from click.testing import CliRunner
from commands import ROOT, mjbench
from example_races import compared, raced
from example_records import measurement, model_record
from set_files import labelled, run_file

from mjbench.cli import cli

RUNS = ROOT / "results/runs"


def stored_run(folder: Path, jax: str, seconds: float) -> str:
    machine = labelled("a", versions={"jax": jax})
    row = measurement(path="mjx", precision="float32", device="cpu", samples_s=[seconds] * 9)
    return str(run_file(folder, machine, model_record(), row))


def test_the_order_of_two_runs_is_that_of_their_times(tmp_path: Path) -> None:
    early, late = (
        run_file(tmp_path / began, labelled("a"), *compared(raced(steps=steps)), began=began)
        for began, steps in (("2026-11-01", 1000), ("2026-11-02", 500))
    )
    for files in ((early, late), (late, early)):
        done = CliRunner().invoke(cli, ["show", *map(str, files)])
        assert f"OLD: {early}" in done.stdout
        assert "2.000" in done.stdout


def test_it_compares_run_files_and_refuses_other_versions_of_jax(tmp_path: Path) -> None:
    old = stored_run(tmp_path / "old", "1", 1.0)
    new = stored_run(tmp_path / "new", "2", 1.5)
    refused = mjbench("show", old, new)
    assert refused.returncode == 2
    assert "they differ in jax (2, 1)" in refused.stdout
    compared = mjbench("show", old, new, "--across", "--json", "-")
    assert compared.returncode == 0, compared.stderr
    assert json.loads(compared.stdout)["results"][0]["ratio"]["estimate"] == pytest.approx(1.5)


def test_run_files_with_nothing_in_common_are_bad_input(tmp_path: Path) -> None:
    files = [str(run_file(tmp_path, labelled("a"), model_record())) for _ in range(2)]
    done = CliRunner().invoke(cli, ["show", *files])
    assert done.exit_code == 2
    assert "have no timed row in common" in done.stderr


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
    words = ["show", str(old), str(new), "--fail-on", findings]
    words += [f"--{flag}"] * bool(flag)
    done = CliRunner().invoke(cli, words)
    written = CliRunner().invoke(cli, [*words, "--json", "-"])
    assert written.exit_code == done.exit_code
    verdicts = [row["verdict"] for row in json.loads(written.stdout)["results"]]
    assert set(verdicts) == {verdict, None}  # the slow paths leave the race early
    assert done.exit_code == code, done.output
    assert done.stdout.splitlines()[1].startswith(f"Of 4 rows: {4 - verdicts.count(None)} ")


@pytest.mark.parametrize(("finding", "code"), [("changed-work", 1), ("slower", 0)])
def test_a_stored_verdict_fails_in_ci(finding: str, code: int) -> None:
    run = RUNS / "reference-story-versions.jsonl"
    assert CliRunner().invoke(cli, ["show", str(run), "--fail-on", finding]).exit_code == code


def test_of_several_runs_the_one_that_decides_is_named() -> None:
    runs = [str(RUNS / f"reference-{name}.jsonl") for name in ("story-versions", "story-env")]
    done = CliRunner().invoke(cli, ["show", *runs, "--fail-on", "changed-work"])
    assert done.exit_code == 1
    assert "exit code 1: mjbench versions" in done.stderr


def test_a_disturbed_run_decides_nothing(tmp_path: Path) -> None:
    old, new = raced_run(tmp_path / "old", 1.0), raced_run(tmp_path / "new", 2.0, cores=0.5)
    words = ["show", str(old), str(new), "--fail-on", "slower"]
    done = CliRunner().invoke(cli, words)
    assert done.exit_code == 3
    assert "undecided" in done.stdout


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--fail-on", "slower", f"{RUNS}/reference-mujoco-4.0.0.jsonl"], "two runs of `compare`"),
        (["--code", "--html", "x"], "--code is for what is printed"),
        (["--markdown", "-", "--json", "-"], "--json - is what --markdown writes, too"),
    ],
)
def test_options_of_show_that_do_not_go_together_are_refused(
    words: list[str], message: str
) -> None:
    done = mjbench("show", *words)
    assert done.returncode == 2
    assert message in done.stderr
