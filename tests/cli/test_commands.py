"""The commands as a user types them, each in a process of its own."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from commands import PYTHONPATH, mjbench

# Small enough to be quick; what is tested is what is said, not how fast it is.
QUICK = ["--nbatch", "6", "--nstep", "40", "--budget", "0", "--results", "runs"]


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
    found = row(document, path)
    assert (found["status"], found["agrees"]) == ("disagrees", False)
    assert found["step_ns"] is found["speedup"] is found["steps_per_s"] is None
    culprit = {"LastUnstepped": 5, "LateError": 3}.get(name, 0)
    assert f"simulation {culprit}" in found["agreement"]
    if field:
        assert found["agreement"].removeprefix("in a timed block: ").startswith(field)
    if step:
        assert f"after step {step}:" in found["agreement"]
    assert row(document, "python_loop")["agrees"] is True
    assert path not in [a["path"] for a in document["advice"]]
    assert " NO" in done.stdout
    assert found["agreement"] in done.stdout


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
    asked = ["--paths", f"{path},python_loop_hold", "--time-limit", "5"]
    done, document = compare(tmp_path, contact_file, *asked)
    assert done.returncode == 3
    assert row(document, path)["status"] == status
    assert words in row(document, path)["detail"]
    assert row(document, "python_loop_hold")["step_ns"] is not None


def test_a_model_that_diverges_is_told_and_the_others_are_measured(
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
    words = ["--nbatch", "64", "--nstep", "30", "--budget", "0", "--results", "runs"]
    done = mjbench("compare", "edge.xml", *words, "--json", "out.json", cwd=tmp_path)
    document = json.loads((tmp_path / "out.json").read_text())
    found = row(document, "python_loop")
    if not 0 < found["diverged"] < 64:
        pytest.fail(f"the model no longer diverges in part: {found['diverged']} of 64")
    assert done.returncode == 0
    assert found["nbatch"] == 64 - found["diverged"]
    assert "diverged and are left out" in done.stdout
    assert all(r["agrees"] for r in document["results"] if r["status"] == "ok")


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (["compare", "cartpoel"], 2, "did you mean cartpole"),
        (["compare", "missing.xml"], 2, "no such file"),
        (["compare", "broken.xml"], 2, "MuJoCo cannot load it"),
        (["compare", "empty.xml"], 2, "MuJoCo cannot load it"),
        (["compare", "still.xml"], 2, "nothing to step"),
        (["compare", "notes.txt"], 2, "ends in .xml or .mjb"),
        (["compare", "."], 2, "is a folder"),
        (["compare", "no_such_package:ant"], 2, "pip install no_such_package"),
        (["compare", "cartpole", "--paths", "rolout"], 2, "did you mean rollout"),
        (["compare", "cartpole", "--nbatch", "0"], 2, "0 is below 1"),
        (["compare", "cartpole", "--nstep", "-5"], 2, "-5 is not in the range"),
        (["compare", "cartpole", "--nstep", "10", "--hold", "3"], 2, "not a multiple"),
        (["compare", "cartpole", "--nbatch", "1000000000"], 2, "lower --nbatch"),
        (["compare", "cartpole", "--threads", "0"], 2, "below 1"),
        (["compare", "cartpole", "--threads", "two"], 2, "whole numbers"),
        (["compare", "cartpole", "--option", "pool=warm"], 2, "pool is one of kept, new"),
        (["compare", "cartpole", "--option", "colour=red"], 2, "NAME one of"),
        (["compare", "cartpole", "--results", "notes.txt"], 3, "cannot write results"),
        (["compare", "cartpole", "--json", "no/such/folder.json"], 3, "cannot write"),
        (["models", "broken.xml"], 2, "MuJoCo cannot load it"),
        (["show", "missing.jsonl"], 2, "cannot read"),
        (["show", "notes.txt"], 2, "not a run file"),
        (["show"], 2, "no run file in"),
        (["comapre"], 2, "No such command"),
    ],
)
def test_bad_input_ends_in_one_clear_line(
    tmp_path: Path, words: list[str], code: int, message: str
) -> None:
    (tmp_path / "broken.xml").write_text("<mujoco><worldbody>")
    (tmp_path / "empty.xml").write_text("")
    (tmp_path / "still.xml").write_text("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>")
    (tmp_path / "notes.txt").write_text("not a run\n")
    done = mjbench(*words, cwd=tmp_path)
    assert done.returncode == code
    assert message in done.stderr + done.stdout


def test_a_read_only_results_folder_is_told_before_anything_is_measured(tmp_path: Path) -> None:
    done = mjbench("compare", "cartpole", "--results", "/proc/results", cwd=tmp_path)
    assert done.returncode == 3
    assert "--results" in done.stderr
    assert done.stdout == ""


def test_a_full_disk_is_told_and_the_table_is_still_shown(
    tmp_path: Path, contact_file: str
) -> None:
    words = ["compare", contact_file, "--paths", "python_loop", *QUICK]
    mjbench(*words, cwd=tmp_path)
    (file,) = (tmp_path / "runs").glob("*.jsonl")
    size = len(file.read_text().splitlines()[0]) + 100  # room for little more than the header
    done = mjbench(*words, cwd=tmp_path, preexec_fn=lambda: _limit_file_size(size))
    assert done.returncode == 3
    assert "cannot write" in done.stderr
    assert "steps/s" in done.stdout


def _limit_file_size(size: int) -> None:
    import resource

    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))


@pytest.mark.parametrize("when", ["at once", "while a path hangs"])
def test_ctrl_c_is_one_line_and_keeps_what_was_measured(
    tmp_path: Path, contact_file: str, when: str
) -> None:
    words = ["--paths", "python_loop_hold,wrong_paths:Tells,wrong_paths:Hangs", *QUICK]
    os.mkfifo(tmp_path / "pipe")
    process = subprocess.Popen(
        [sys.executable, "-m", "mjbench", "compare", contact_file, *words],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": PYTHONPATH,
             "MJBENCH_TEST_PIPE": str(tmp_path / "pipe")},
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    if when == "while a path hangs":
        (tmp_path / "pipe").read_text()  # returns when the path before it was prepared
    process.send_signal(signal.SIGINT)
    try:
        out, err = process.communicate(timeout=30)
    except subprocess.TimeoutExpired:  # an interpreter that starts may lose the first one
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=120)
    assert "Traceback" not in out + err
    if when == "at once":
        assert process.returncode in (-signal.SIGINT, 130)
        return
    assert process.returncode == 130
    assert err.count("\n") == 1
    (file,) = (tmp_path / "runs").glob("*.jsonl")
    statuses = [json.loads(line).get("status") for line in file.read_text().splitlines()]
    assert statuses == [None, *["interrupted"] * 5]


def test_a_closed_output_is_no_traceback(tmp_path: Path, contact_file: str) -> None:
    words = ["compare", contact_file, "--paths", "python_loop", *QUICK]
    process = subprocess.Popen(
        [sys.executable, "-m", "mjbench", *words],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": PYTHONPATH},
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert process.stdout is not None
    assert process.stderr is not None
    process.stdout.close()
    assert "Traceback" not in process.stderr.read()
    process.stderr.close()
    assert process.wait() == 3
    assert list((tmp_path / "runs").glob("*.jsonl"))


def test_models_lists_ours_with_their_facts(tmp_path: Path) -> None:
    done = mjbench("models", "--json", "-", cwd=tmp_path)
    assert done.returncode == 0
    rows = json.loads(done.stdout)["models"]
    assert len(rows) >= 10
    assert all(r["status"] == "ok" and r["nv"] > 0 and r["timestep"] > 0 for r in rows)


def test_paths_lists_what_is_available(tmp_path: Path) -> None:
    done = mjbench("paths", "--json", "-", cwd=tmp_path)
    rows = {r["path"]: r for r in json.loads(done.stdout)["paths"]}
    assert rows["python_loop"]["closed_loop"] is True
    assert rows["rollout"]["closed_loop"] is False


def test_help_and_version_need_no_engine(tmp_path: Path) -> None:
    program = (
        "import sys; sys.argv = ['mjbench', sys.argv[1]]\n"
        "from mjbench.__main__ import main\n"
        "try: main()\nexcept SystemExit: pass\n"
        "heavy = {'mujoco', 'numpy', 'jax', 'scipy', 'plotly', 'rich.console'} & set(sys.modules)\n"
        "sys.exit(f'imported {heavy}' if heavy else 0)\n"
    )
    for word in ("--help", "--version"):
        done = subprocess.run(
            [sys.executable, "-c", program, word],
            env={**os.environ, "PYTHONPATH": PYTHONPATH},
            capture_output=True, text=True, timeout=60,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        assert "mjbench" in done.stdout


def test_without_its_optional_packages_the_command_says_what_to_install(tmp_path: Path) -> None:
    program = "import sys; sys.modules['click'] = None\nfrom mjbench.__main__ import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", program],
        env={**os.environ, "PYTHONPATH": PYTHONPATH},
        capture_output=True, text=True, timeout=60,
    )  # fmt: skip
    assert done.returncode != 0
    assert 'pip install "mjbench[cli]"' in done.stderr
    assert "Traceback" not in done.stderr
