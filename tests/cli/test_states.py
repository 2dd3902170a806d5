"""`--states` and `--actions`, in every command that steps a model from given states."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from click.testing import CliRunner
from commands import mjbench as run_mjbench
from step_profiles import step_profile

import mjbench
from mjbench.cli import cli
from mjbench.commands.profile import measure as profile
from mjbench.simulation import models

TAKES_STATES = (
    ("compare", "cartpole"),
    ("compare", "cartpole", "--scaling"),
    ("versions", "installed", "installed", "cartpole"),
    ("versions", "installed", "installed", "cartpole", "--metric", "instructions"),
    ("ab", "cartpole", "cartpole"),
    ("versions", "--explain", "installed", "installed", "cartpole"),
    ("profile", "--instructions", "cartpole"),
    ("latency", "cartpole"),
    ("profile", "cartpole"),
    ("profile", "--habits", "cartpole"),
)
# These hold controls, or choose them.
TAKES_NO_ACTIONS = ("profile", "overhead")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder with captured states of the cart-pole, and actions."""
    model = models.load(models.resolve("cartpole"))
    data = mujoco.MjData(model)
    with mjbench.capture(tmp_path / "states.npz", save_model=tmp_path / "robot.mjb"):
        for i in range(400):
            data.ctrl[:] = np.sin(0.1 * i)
            mujoco.mj_step(model, data)
    np.savez(tmp_path / "actions.npz", actions=0.1 * np.ones((30, 1)))
    return tmp_path


def results(folder: Path, *arguments: str) -> Sequence[dict[str, Any]]:
    done = run_mjbench(*arguments, "--json", "out.json", cwd=folder)
    assert done.returncode == 0, done.stderr
    rows: Sequence[dict[str, Any]] = json.loads((folder / "out.json").read_text())["results"]
    return rows


@pytest.mark.parametrize("arguments", TAKES_STATES, ids=" ".join)
def test_a_missing_file_is_refused_before_anything_is_measured(arguments: Sequence[str]) -> None:
    options = ["--states"] if arguments[0] in TAKES_NO_ACTIONS else ["--states", "--actions"]
    for option in options:
        done = CliRunner().invoke(cli, [*arguments, option, "none.npz"])
        assert done.exit_code == 2
        assert done.stderr == f"mjbench: {option} none.npz: no such file\n"


@pytest.mark.parametrize("content", [b"", b"\x93NUMPY", b"PK", b"text"])
def test_a_file_of_another_kind_is_refused(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "states.npz"
    file.write_bytes(content)
    done = CliRunner().invoke(cli, ["profile", "cartpole", "--states", str(file)])
    assert done.exit_code == 2
    assert "not an .npz file, as numpy.savez writes it" in done.stderr


def test_compare_replays_captured_states_or_actions_and_continues_with_no_others(
    folder: Path,
) -> None:
    compare = ("compare", "robot.mjb", "--paths", "python_loop", "--budget", "0.01")
    row, _ = results(folder, *compare, "--states", "states.npz")
    assert row["starts"]["file"] == row["starts"]["controls_file"] == "states.npz"
    assert not row["starts"]["is_other_model"]
    assert (row["nbatch"], row["nstep"]) == (64, 61)  # 16 starts in each of 4 windows
    both = (*compare, "--states", "states.npz", "--actions", "actions.npz", "--hold", "5")
    row, _ = results(folder, *both)
    assert (row["starts"]["controls_file"], row["nstep"]) == ("actions.npz", 60)
    latest = max((folder / "results/runs").glob("*.jsonl"), key=lambda file: file.stat().st_mtime)
    header = json.loads(latest.read_text().splitlines()[0])
    files = [file["name"] for file in header["files"]]
    assert files == ["robot.mjb", "states.npz", "actions.npz"]
    assert str(folder) not in latest.read_text()
    np.savez(folder / "actions.npz", actions=np.zeros((30, 1)))
    refused = run_mjbench(*both, "--resume", str(latest), cwd=folder)
    assert refused.returncode == 2
    assert "actions.npz has changed since that run began" in refused.stderr


def test_states_of_another_model_cost_one_line(folder: Path, inline: None) -> None:
    done = run_mjbench("latency", "humanoid", "--states", "states.npz", cwd=folder)
    assert done.returncode == 2
    assert "humanoid: states.npz holds states of another model, cartpole: nq 2" in done.stderr
    assert done.stderr.count("\n") == 1


def test_latency_of_captured_states_says_so(folder: Path, inline: None) -> None:
    arguments = ("latency", "cartpole", "--nstep", "200", "--rate", "10000", "--tick", "2")
    free, _ = results(folder, *arguments, "--states", "states.npz")
    assert free["starts"]["file"] == "states.npz"


def test_profile_is_given_the_file_and_stores_its_digest(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    given: list[Any] = []

    def measure(*arguments: Any) -> profile.ProfileRow:
        given.append(arguments[2])
        return step_profile()

    monkeypatch.setattr(profile, "measure", measure)
    monkeypatch.chdir(folder)
    done = CliRunner().invoke(cli, ["profile", "robot.mjb", "--states", "states.npz"])
    assert done.exit_code == 0, done.output
    assert [plan.file for plan in given] == [folder / "states.npz"]
    (file,) = (folder / "results/runs").glob("*.jsonl")
    header = json.loads(file.read_text().splitlines()[0])
    assert [f["name"] for f in header["files"]] == ["robot.mjb", "states.npz"]
    assert header["files"][1]["sha256"]
    assert header["arguments"]["starts"]["file"] == "states.npz"
