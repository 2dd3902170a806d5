"""`mjbench env` as a user types it."""

import importlib.util
import json
from pathlib import Path

import pytest
from commands import mjbench

from mjbench.commands.env import vectors
from mjbench.commands.env.options import EnvironmentOptions

QUICK = ["--nstep", "40", "--budget", "0.1", "--threads", "1", "--skip", "vectors"]


def test_it_measures_and_writes_json_and_show_prints_it_again(tmp_path: Path) -> None:
    arguments = ["env", "example_environments:wrapped", *QUICK, "--json", "out.json"]
    done = mjbench(*arguments, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    beginning = done.stdout.splitlines()[1:4]  # two cautions may come before
    assert any("of env.step is physics" in line for line in beginning)
    (row,) = json.loads((tmp_path / "out.json").read_text())["results"]
    assert row["environment"] == "example_environments:wrapped"
    assert row["env_steps_per_s"] > 0
    assert row["check"]["status"] == "ok"
    assert sum(layer["share"]["estimate"] for layer in row["layers"]) == pytest.approx(1, abs=0.1)
    assert row["paths"][0]["path"] == "python_loop"
    again = mjbench("show", "--json", "-", cwd=tmp_path)
    assert json.loads(again.stdout)["results"] == [row]
    assert "of env.step is physics" in mjbench("show", cwd=tmp_path).stdout
    report = mjbench("show", "--markdown", "-", cwd=tmp_path)
    assert "where a step's time goes" in report.stdout


def test_an_environment_that_fails_costs_its_row(tmp_path: Path, inline: None) -> None:
    names = ["example_environments:Raises", "example_environments:make"]
    done = mjbench("env", *names, *QUICK, "--json", "out.json", cwd=tmp_path)
    assert done.returncode == 2
    assert "Raises: its step raised KeyError" in done.stderr
    rows = json.loads((tmp_path / "out.json").read_text())["results"]
    assert [row["status"] for row in rows] == ["input", "ok"]


def test_physics_that_a_plain_loop_does_not_repeat_is_a_finding(
    tmp_path: Path, inline: None
) -> None:
    done = mjbench("env", "example_environments:StaleStart", *QUICK, cwd=tmp_path)
    assert done.returncode == 1
    assert "NOT the same physics as a plain loop: qpos[7] is" in done.stdout


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["env"], "Missing argument"),
        (["env", "robot.xml"], "`mjbench profile` takes models"),
        (["env", "dm_control:humanoid"], "give dm_control:DOMAIN-TASK"),
        (["env", "no_such_module:make"], "no module no_such_module"),
        (["env", "example_environments:mak"], "did you mean make"),
        (["env", "example_environments:number"], "int is no environment"),
        (["env", "a:make", "--nstep", "0"], "'0' is not a whole number, at least 1"),
        (["env", "a:make", "--skip", "vectors", "--nbatch", "2"], "not both"),
    ],
)
def test_bad_input_ends_in_one_clear_line(
    tmp_path: Path, arguments: list[str], message: str
) -> None:
    done = mjbench(*arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert message in done.stderr


def test_a_hanging_environment_is_killed(tmp_path: Path) -> None:
    arguments = ["env", "example_environments:Hangs", *QUICK, "--time-limit", "4s"]
    done = mjbench(*arguments, cwd=tmp_path)
    assert done.returncode == 3
    assert "no answer within 4 s, killed (--time-limit)" in done.stderr


STACK = """
import gymnasium
import numpy as np
from gymnasium import wrappers

class Clip(gymnasium.ActionWrapper):
    def action(self, action):
        return np.clip(action, -0.5, 0.5)

def make():
    env = wrappers.RecordEpisodeStatistics(Clip(gymnasium.make("InvertedPendulum-v5")))
    env = wrappers.TransformReward(env, lambda reward: 0.1 * reward)
    return wrappers.TransformReward(wrappers.NormalizeObservation(env), abs)
"""


@pytest.mark.skipif(not importlib.util.find_spec("gymnasium"), reason="needs gymnasium")
def test_environments_of_gymnasium_are_measured_with_each_of_their_wrappers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, inline: None
) -> None:
    monkeypatch.setattr(vectors, "LEAST_LAUNCHES", 2)
    monkeypatch.setattr(EnvironmentOptions, "EACH_S", 0.1)
    (tmp_path / "stack.py").write_text(STACK)
    quick = ["--nstep", "50", "--json", "out.json"]
    rows = []
    for words in (["InvertedPendulum-v5", "--skip", "vectors"], ["stack:make", "--nbatch", "2"]):
        done = mjbench("env", *words, *quick, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        (row,) = json.loads((tmp_path / "out.json").read_text())["results"]
        assert row["check"]["status"] == "ok"
        rows.append(row)
    plain, stack = rows
    assert plain["facts"]["unrepeated"] == []
    forms = [(vector["form"], vector["status"]) for vector in stack["vectors"]]
    assert forms == [("SyncVectorEnv", "ok"), ("AsyncVectorEnv", "ok")]
    assert [each["field"] for each in stack["facts"]["unrepeated"]] == ["observation"]
    (layer,) = (each for each in stack["layers"] if each["layer"] == "wrappers")
    assert {
        function["name"]: function["calls"] for function in layer["functions"]
    } == dict.fromkeys(
        [
            "TransformReward 1",
            "NormalizeObservation",
            "TransformReward 2",
            "RecordEpisodeStatistics",
            "Clip",
            "TimeLimit",
            "OrderEnforcing",
            "PassiveEnvChecker",
        ],
        1,
    )
