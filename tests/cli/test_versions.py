"""`mjbench versions`: table, sentence, JSON, run file and exit codes."""

import json
from pathlib import Path

import broken_worker
import pytest
from commands import mjbench
from paired_examples import decided

from mjbench.paired import time_limit, verdict

SAME = ("installed", "installed", "cartpole")


def test_versions_gives_a_table_a_sentence_json_and_a_run_file(tmp_path: Path) -> None:
    done = mjbench(
        *("versions", "installed", "installed", "cube_table", "--budget", "0.2s"),
        *("--json", "out.json"),
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stderr
    (row,) = json.loads((tmp_path / "out.json").read_text())["results"]
    assert row["metric"] == "time"
    assert row["changed_work"] is False
    assert row["drift"] == 0.0
    assert row["work"]["old"]["contacts"] > 0
    assert row["launches"] >= 1
    assert row["pairs"] >= 2 * time_limit.LAYOUTS * time_limit.MIN_QUADS
    assert "cube_table" in done.stdout
    assert "same work" in done.stdout
    (file,) = (tmp_path / "results/runs").glob("*.jsonl")
    header, record = map(json.loads, file.read_text().splitlines())
    assert header["arguments"]["time_limit_s"] == 0.2
    assert record["type"] == "verdict"
    assert len(record["samples"]) == row["launches"]
    again = mjbench("show", cwd=tmp_path)
    assert again.returncode == 0
    assert "same work" in again.stdout


def test_verdicts_that_are_decided_with_those_of_other_commands_say_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(verdict, "decide_pair", lambda pool, *targets: decided(*targets[:2]))
    words = ("versions", *SAME)
    for family in ("30", "1"):
        done = mjbench(*words, "--family", family, "--results", family, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        (file,) = (tmp_path / family).glob("*.jsonl")
        header = json.loads(file.read_text().splitlines()[0])
        assert header["arguments"]["family"] == int(family)


def test_a_target_that_fails_ends_in_exit_code_3(tmp_path: Path) -> None:
    done = mjbench(
        *("versions", *SAME),
        cwd=tmp_path,
        env={"PYTHONPATH": broken_worker.python_path(tmp_path, "load_model", "os._exit(7)")},
    )
    assert done.returncode == 3
    assert "baseline (MuJoCo" in done.stdout


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("installed",), "name an OLD and a NEW release"),
        (
            (*SAME, "--metric", "memory", "--paths", "rollout"),
            "--metric memory steps by python_loop only",
        ),
        (("installed", "cartpole"), "name an OLD and a NEW release"),
        (("installed", "installed"), "name a model, one of cartpole, "),
        (
            ("installed", "main"),
            "main is neither a release nor a model: a release is a version such",
        ),
        (("installed", "instaled"), "neither a release nor a model (did you mean installed?)"),
        (("installed", "installed", "cartpol"), "nor a model (did you mean cartpole?)"),
        (("installed", "installed", "no.xml"), "no such file: no.xml"),
        (("installed", "."), ". is a folder without wheels; name wheels of mujoco, or a model's"),
        (("missing.whl", "installed", "pile"), "no such wheel"),
        ((*SAME, "--fail-on", "tea"), "'tea' is not one of"),
        ((*SAME, "--min-effect", "0"), "above 0% and below 100%"),
        ((*SAME, "--budget", "soon"), "not a time such as 60s"),
        ((*SAME, "--paths", "mjx"), "name the packages in place of installed"),
        ((*SAME, "--paths", "mjx,rollout"), "compile: leave out rollout"),
        ((*SAME, "--paths", "mjx", "--metric", "load"), "leave out --metric"),
        (("jax==0.7.0", "jax==0.7.1", "cartpole"), "python_loop does not use jax: name a path"),
        (("numpy==", "numpy==2.4.0", "pile"), "numpy== is no package"),
        (
            ("installed", "3.5.0", "cartpole", "bench.py::step"),
            "name models or functions, not both",
        ),
        (("installed", "3.5.0", "none.py::step"), "there is no file"),
        (("installed", "3.5.0", "bench:step"), "a function is FILE.py::FUNCTION, such as bench.py"),
        (("installed", "3.5.0", "b.py::f", "--paths", "mjx"), "are of models"),
        (("installed", "3.5.0", "b.py::f", "--nstep", "2"), "are of models"),
        ((*SAME, "--nstep", "5", "--hold", "2"), "not a multiple"),
        ((*SAME, "--states", "no.npz"), "--states no.npz: no such file"),
        ((*SAME, "--states", "empty.npz"), "empty.npz: not an .npz file"),
        ((*SAME, "--states", "empty.npz", "--settle", "0"), "give --settle or --states, not both"),
    ],
)
def test_bad_arguments_are_reported_in_one_line(
    tmp_path: Path, arguments: tuple[str, ...], message: str
) -> None:
    (tmp_path / "empty.npz").touch()
    done = mjbench("versions", *arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert message in done.stderr
