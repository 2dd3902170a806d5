"""`mjbench compare` as a user types it, in a process of its own."""

import json
import re
import subprocess
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from commands import mjbench
from example_records import measurement, model_record

from mjbench.cli import cli
from mjbench.comparison import compare as comparison
from mjbench.comparison.compare import ModelRecords
from mjbench.status import Status

# Small enough to be quick; what is tested is what the command says, not how fast it is.
QUICK = ["--nbatch", "6", "--nstep", "40", "--budget", "0", "--no-confirm", "--results", "runs"]


def compare(cwd: Path, *words: str) -> tuple["subprocess.CompletedProcess[str]", Any]:
    done = mjbench("compare", *words, *QUICK, "--json", "out.json", cwd=cwd)
    return done, json.loads((cwd / "out.json").read_text())


def row(document: Any, path: str) -> Any:
    return next(r for r in document["results"] if r["path"] == path)


def test_compare_gives_speed_agreement_and_advice(tmp_path: Path, contact_file: str) -> None:
    done, document = compare(tmp_path, contact_file, "--threads", "1,2")
    assert done.returncode == 0, done.stderr
    assert {r["status"] for r in document["results"]} <= {"ok", "unavailable"}
    base = row(document, "python_loop")
    assert base["agrees"] is True
    assert base["speedup"]["median"] == 1.0
    assert base["steps_per_s"] == pytest.approx(1e9 / base["step_ns"]["median"])
    assert base["work"]["contacts"] > 0
    assert [a["loop"] for a in document["advice"]] == ["open", "closed"]
    assert "Open loop:" in done.stdout
    assert "Closed loop" in done.stdout


def test_what_is_advised_was_compared_again_in_fresh_processes(
    tmp_path: Path, contact_file: str
) -> None:
    words = ["--paths", "python_loop_hold", *QUICK, "--confirm", "--json", "out.json"]
    done = mjbench("compare", contact_file, *words, "--hold", "2", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    document = json.loads((tmp_path / "out.json").read_text())
    assert {a["reason"] for a in document["advice"]} <= {"faster", "simpler", "no gain"}
    (file,) = (tmp_path / "runs").glob("*.jsonl")
    records = [json.loads(line) for line in file.read_text().splitlines()]
    again_types = {"confirmation", "contest"}
    clock, contest = sorted(
        (r for r in records if r["type"] in again_types), key=lambda r: str(r["type"])
    )
    assert (clock["baseline"], clock["candidate"]) == ("python_loop", "python_loop")
    assert clock["ratio"]["low"] < clock["ratio"]["high"]
    assert contest["status"] == "ok"
    assert [v["path"] for v in contest["variants"]] == ["python_loop", "python_loop_hold"]
    assert len(contest["launches"]) >= 8
    again = mjbench("show", str(file), "--json", "-", cwd=tmp_path)
    assert json.loads(again.stdout) == document


def test_without_confirmation_only_the_plain_loop_is_advised(
    tmp_path: Path, contact_file: str
) -> None:
    _, document = compare(tmp_path, contact_file)
    assert {a["path"] for a in document["advice"]} == {"python_loop"}


@pytest.mark.parametrize("returns", ["trajectory", "sensors"])
def test_paths_are_compared_by_what_they_return(
    tmp_path: Path, contact_file: str, returns: str
) -> None:
    words = ("--returns", returns, "--threads", "1,2", "--hold", "2")
    done, document = compare(tmp_path, contact_file, *words)
    assert done.returncode == 0, done.stderr
    statuses = {r["path"]: r["status"] for r in document["results"]}
    assert statuses.pop("python_loop_hold") == "unavailable"
    assert set(statuses.values()) <= {"ok", "unavailable"}
    assert {r["returns"] for r in document["results"]} == {returns}
    assert "Not compared: python_loop_hold: returns no state between" in done.stdout


def test_the_code_of_what_is_advised_is_printed_once_and_only_if_asked_for(
    tmp_path: Path, contact_file: str
) -> None:
    done, _ = compare(tmp_path, contact_file, "--paths", "python_loop")
    assert "import mujoco" not in done.stdout
    assert "--code prints" in done.stdout
    done, _ = compare(tmp_path, contact_file, "--paths", "python_loop", "--code")
    assert done.stdout.count("import mujoco") == 1


def test_the_run_file_holds_raw_samples_and_show_prints_it_again(
    tmp_path: Path, contact_file: str
) -> None:
    _, document = compare(tmp_path, contact_file, "--paths", "python_loop_hold")
    (file,) = (tmp_path / "runs").glob("*.jsonl")
    header, head, *rows = map(json.loads, file.read_text().splitlines())
    assert (header["type"], header["schema"], head["type"]) == ("run", 1, "model")
    assert [r["path"] for r in rows] == ["python_loop", "python_loop_hold"]
    assert all(len(r["samples_s"]) >= 7 for r in rows)
    again = mjbench("show", str(file), "--json", "-", cwd=tmp_path)
    assert json.loads(again.stdout) == document


def test_json_to_stdout_is_one_document_and_nothing_else(tmp_path: Path, contact_file: str) -> None:
    words = ["--paths", "python_loop", *QUICK, "--json", "-"]
    done = mjbench("compare", contact_file, *words, cwd=tmp_path)
    assert json.loads(done.stdout)["schema"] == 1
    assert "python_loop" in done.stderr


@pytest.mark.parametrize(
    ("name", "field", "step"),
    [
        ("ColdWarmStart", None, 1),
        ("OneStepFewer", "time", 1),
        ("ControlShifted", None, 2),
        ("LastUnstepped", "time", 1),
        ("LateError", None, 30),
        ("WrongWhenTimed", "time", None),
    ],
)
def test_a_wrong_path_is_caught_named_and_shown_without_a_speed(
    tmp_path: Path, contact_file: str, name: str, field: str | None, step: int | None
) -> None:
    path = f"wrong_paths:{name}"
    done, document = compare(tmp_path, contact_file, "--paths", path)
    assert done.returncode == 1
    result = row(document, path)
    assert (result["status"], result["agrees"]) == ("disagrees", False)
    assert result["step_ns"] is result["speedup"] is result["steps_per_s"] is None
    # Each block has its own order of simulations, and how many blocks run depends on their speed.
    culprit = {"LastUnstepped": "5", "LateError": "3", "WrongWhenTimed": "[0-5]"}.get(name, "0")
    assert re.search(f"simulation {culprit} ", result["agreement"])
    if field:
        assert result["agreement"].removeprefix("in a timed block: ").startswith(field)
    if step:
        assert f"after step {step}:" in result["agreement"]
    assert row(document, "python_loop")["agrees"] is True
    assert path not in [a["path"] for a in document["advice"]]
    assert " NO" in done.stdout
    assert result["agreement"] in done.stdout


def test_the_wrong_paths_are_right_without_their_fault(tmp_path: Path, contact_file: str) -> None:
    done, document = compare(tmp_path, contact_file, "--paths", "wrong_paths:Right")
    assert done.returncode == 0
    assert row(document, "wrong_paths:Right")["agrees"] is True


def test_a_lost_warm_start_is_caught_on_a_model_without_contact(tmp_path: Path) -> None:
    path = "wrong_paths:ColdWarmStart"
    done, document = compare(tmp_path, "cartpole", "--paths", path)
    assert done.returncode == 1
    assert "cube_table" in row(document, path)["agreement"]


@pytest.mark.parametrize(
    ("name", "status", "words"),
    [
        ("Crashes", "crashed", "signal 11 (SIGSEGV) while preparing wrong_paths:Crashes"),
        ("Hangs", "timeout", "no answer within 5 s"),
        ("Raises", "failed", "RuntimeError: out of luck"),
    ],
)
def test_a_path_that_dies_costs_only_its_own_row(
    tmp_path: Path, contact_file: str, name: str, status: str, words: str
) -> None:
    path = f"wrong_paths:{name}"
    arguments = ["--paths", f"{path},python_loop_hold", "--time-limit", "5"]
    done, document = compare(tmp_path, contact_file, *arguments)
    assert done.returncode == 3
    assert row(document, path)["status"] == status
    assert words in row(document, path)["detail"]
    assert row(document, "python_loop_hold")["step_ns"] is not None


def test_a_model_that_diverges_is_reported_and_the_others_are_measured(
    tmp_path: Path, contact_file: str
) -> None:
    unstable = (
        "<mujoco><option timestep='.1'/><worldbody><body><joint name='j' type='slide'"
        " stiffness='1e9'/><geom size='.1' mass='.001'/></body></worldbody></mujoco>"
    )
    (tmp_path / "unstable.xml").write_text(unstable)
    done, document = compare(tmp_path, "unstable.xml", contact_file, "--paths", "python_loop")
    assert done.returncode == 2
    first, second = document["results"]
    assert first["step_ns"] is None
    assert "diverges" in first["detail"]
    assert second["step_ns"] is not None


def test_a_model_that_steps_for_ever_costs_only_its_own_rows(
    tmp_path: Path, contact_file: str
) -> None:
    endless = (
        "<mujoco><option solver='PGS' iterations='2147483647' tolerance='0'"
        " noslip_iterations='2147483647'/><worldbody><geom type='plane' size='1 1 1'/>"
        "<body pos='0 0 .099'><freejoint/><geom type='box' size='.1 .1 .1'/></body>"
        "</worldbody></mujoco>"
    )
    (tmp_path / "endless.xml").write_text(endless)
    words = ["--paths", "python_loop", "--time-limit", "3"]
    done, document = compare(tmp_path, "endless.xml", contact_file, *words)
    assert done.returncode == 3
    first, second = document["results"]
    assert (first["status"], first["step_ns"]) == ("timeout", None)
    assert "no answer within 3 s" in first["detail"]
    assert second["step_ns"] is not None
    listed = mjbench("models", "endless.xml", "cartpole", "--time-limit", "3", cwd=tmp_path)
    assert listed.returncode == 3
    assert "cartpole" in listed.stdout


def test_some_diverging_simulations_are_left_out_and_counted(tmp_path: Path) -> None:
    # unstable only where the random start velocity is positive: it leaves a spring-free stretch
    xml = (
        "<mujoco><option timestep='.05' gravity='0 0 0'><flag contact='disable'/></option>"
        "<worldbody><body><joint name='a' type='slide' axis='1 0 0'/><geom size='.1'/></body>"
        "<body pos='0 1 0'><joint name='b' type='slide' axis='1 0 0' limited='true' range='-9 0'"
        " solreflimit='-1e7 -1'/><geom size='.1' mass='.01'/></body></worldbody>"
        "<keyframe><key qpos='0 -.0003'/></keyframe></mujoco>"
    )
    (tmp_path / "edge.xml").write_text(xml)
    words = [
        "--nbatch",
        "64",
        "--nstep",
        "30",
        "--budget",
        "0",
        "--no-confirm",
        "--results",
        "runs",
    ]
    done = mjbench("compare", "edge.xml", *words, "--json", "out.json", cwd=tmp_path)
    document = json.loads((tmp_path / "out.json").read_text())
    result = row(document, "python_loop")
    if not 0 < result["diverged"] < 64:
        pytest.fail(f"the model no longer diverges in part: {result['diverged']} of 64")
    assert done.returncode == 0
    assert result["nbatch"] == 64 - result["diverged"]
    assert "diverged, left out of all figures" in done.stdout
    assert all(r["agrees"] for r in document["results"] if r["status"] == "ok")


def test_a_model_that_fails_after_its_first_rounds_is_not_green(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    records = ModelRecords(
        model_record(status=Status.FAILED, detail="it failed"), (measurement(samples_s=[0.1]),)
    )
    monkeypatch.setattr(comparison, "compare_model", lambda *arguments: records)
    done = CliRunner().invoke(cli, ["compare", "cartpole", "--results", str(tmp_path)])
    assert done.exit_code == 3
    assert "it failed" in done.stdout


def test_a_search_says_how_many_threads(tmp_path: Path, contact_file: str) -> None:
    words = ["--scaling", "--paths", "rollout,threads", "--threads", "1,2", "--chunk", "2"]
    words += ["--nbatch", "4,8", "--nstep", "10", "--budget", "0", "--no-confirm"]
    words += ["--results", "runs", "--json", "out.json"]
    done = mjbench("compare", contact_file, *words, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    document = json.loads((tmp_path / "out.json").read_text())
    stages = {row["stage"] for row in document["scaling"]}
    assert {"threads", "simulations"} <= stages <= {"threads", "chunk size", "simulations"}
    assert {row["path"] for row in document["threads"]} == {"rollout", "threads"}
    assert {row["nthread"] for row in document["threads"]} == {1}  # none was compared again
    assert all(row["agrees"] for row in document["results"])
    (file,) = (tmp_path / "runs").glob("*.jsonl")
    again = mjbench("show", str(file), "--json", "-", cwd=tmp_path)
    assert json.loads(again.stdout) == document
    # a run that is continued makes no run of the search again
    count = len(file.read_text().splitlines())
    done = mjbench("compare", contact_file, *words, "--resume", str(file), cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert len(file.read_text().splitlines()) == count


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--paths", "python_loop_hold"], "python_loop_hold has no threads to vary"),
        (["--paths", "mjx"], "mjx has no threads to vary"),
        (["--total-steps", "1e6"], "--total-steps has no effect with --scaling"),
        (["--option", "chunk=4"], "--option chunk: give --chunk with --scaling"),
        (["--option", "pool=new,kept"], "--option pool: give one value with --scaling"),
    ],
)
def test_a_search_refuses_what_it_cannot_use(words: list[str], message: str) -> None:
    result = CliRunner().invoke(cli, ["compare", "cartpole", "--scaling", *words])
    assert result.exit_code == 2
    assert message in result.output
