"""`mjbench web` as a user types it; a program that steps C stands in for Node."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import pretending_node
import pytest
from commands import mjbench
from example_web_records import record, wasm

from mjbench.status import Status
from mjbench.web import measure

QUICK = ["--budget", "0", "--nbatch", "3", "--nstep", "20", "--settle", "0"]


@pytest.fixture
def words(tmp_path: Path) -> list[str]:
    """Return the options that name the pretended Node, package and release."""
    program = pretending_node.program(tmp_path)
    package = pretending_node.package(tmp_path / "app", mujoco.__version__)
    named = ["--node", str(program), "--package", str(package), "--release", "installed"]
    return [*named, *QUICK, "--json", "out.json"]


def document(folder: Path) -> dict[str, Any]:
    content: dict[str, Any] = json.loads((folder / "out.json").read_text())
    return content


def paths(folder: Path) -> dict[str, dict[str, Any]]:
    """Return the rows of the only model, by path and options."""
    (row,) = document(folder)["results"]
    return {path["path"] + "+" * len(path["options"]): path for path in row["paths"]}


def test_builds_that_agree_are_timed_beside_c(tmp_path: Path, words: list[str]) -> None:
    done = mjbench("web", "cartpole", *words, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "in WebAssembly, a step takes" in done.stdout
    assert "its states are C's to the last bit" in done.stdout
    written = document(tmp_path)
    (row,) = written["results"]
    assert (row["release"], row["nbatch"], row["nstep"]) == (mujoco.__version__, 3, 20)
    by_path = paths(tmp_path)
    assert [*by_path][:2] == ["python_loop", "rollout+"]
    for path in ("wasm", "wasm_mt"):
        assert by_path[path]["status"] == "ok"
        assert by_path[path]["check"]["first"] is None
        assert by_path[path]["check"]["unconstrained"]["error"] == 0
        assert by_path[path]["rounds"] == by_path["rollout+"]["rounds"] >= 8
        assert by_path[path]["step_ns"] > 0
        assert by_path[path]["ratio"]["median"] > 0
        assert by_path[path]["start_up"]["compile_ms"] == 3.0
        assert (by_path[path]["heap_bytes"], by_path[path]["rss_bytes"]) == (300, 400)
    assert by_path["rollout+"]["ratio"] == {"median": 1.0, "low": 1.0, "high": 1.0}

    again = mjbench("show", "--json", "-", cwd=tmp_path)
    assert json.loads(again.stdout) == written
    report = mjbench("show", "--markdown", cwd=tmp_path)
    assert "cartpole in WebAssembly" in report.stdout
    table = mjbench("show", "--format", "csv", cwd=tmp_path)
    assert table.stdout.count("\ncartpole,") == len(by_path)


@pytest.mark.parametrize(
    ("status", "code"), [(Status.DISAGREES, 1), (Status.CRASHED, 3), (Status.TIMEOUT, 3)]
)
def test_a_build_that_fails_costs_its_row_and_is_a_finding(
    tmp_path: Path,
    words: list[str],
    monkeypatch: pytest.MonkeyPatch,
    status: Status,
    code: int,
) -> None:
    failed = replace(wasm(), status=status, detail="it went wrong", block_ns=())
    monkeypatch.setattr(measure, "measure", lambda *arguments: record(failed))
    done = mjbench("web", "cartpole", *words, cwd=tmp_path)
    assert done.returncode == code
    assert f"cartpole: wasm: {status}: it went wrong" in done.stdout
    by_path = paths(tmp_path)
    assert (by_path["wasm"]["status"], by_path["wasm"]["step_ns"]) == (status, None)
    assert by_path["rollout"]["step_ns"] > 0


def test_a_model_that_does_not_load_costs_its_row(tmp_path: Path, words: list[str]) -> None:
    (tmp_path / "broken.xml").write_text("<mujoco><nonsense/></mujoco>")
    done = mjbench("web", "broken.xml", *words, cwd=tmp_path)
    assert done.returncode == 2
    (broken,) = document(tmp_path)["results"]
    assert broken["status"] == "input"
    assert "broken.xml: input: " in done.stdout


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (["--node", "no-such-node"], 2, "--node: there is no program no-such-node"),
        (["--release", "3.9.0"], 2, "not 3.9.0: npm install"),
        (["--package", "."], 2, ". has no package @mujoco/mujoco: npm install"),
        (["--actions", "none.npz"], 2, "none.npz: no such file"),
        (["no_such_model"], 2, "no model 'no_such_model'"),
    ],
)
def test_bad_input_ends_in_one_line(
    tmp_path: Path, words: list[str], arguments: list[str], code: int, message: str
) -> None:
    done = mjbench("web", *words, *arguments, cwd=tmp_path)
    assert done.returncode == code
    assert message in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1


def test_a_missing_package_or_node_is_one_line_with_the_remedy(tmp_path: Path) -> None:
    program = pretending_node.program(tmp_path)
    env = {"MJBENCH_CACHE": str(tmp_path / "cache")}
    done = mjbench("web", "cartpole", "--node", str(program), cwd=tmp_path, env=env)
    assert done.returncode == 3
    assert "is not installed: npm install --no-package-lock --prefix" in done.stderr
    package = str(pretending_node.package(tmp_path / "app", mujoco.__version__))
    done = mjbench("web", "--package", package, cwd=tmp_path, env={**env, "PATH": ""})
    assert done.returncode == 3
    assert "Node is not installed: install Node.js" in done.stderr
    assert not (tmp_path / "results").exists()
