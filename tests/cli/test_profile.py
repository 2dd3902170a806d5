"""`mjbench profile` as a user types it."""

import json
from pathlib import Path

import pytest
from commands import mjbench


def test_it_measures_and_writes_json(tmp_path: Path) -> None:
    words = ("profile", "cartpole", "--budget", "0.1s")
    done = mjbench(*words, "--json", "out.json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    (row,) = json.loads((tmp_path / "out.json").read_text())["results"]
    steps = row["steps"]
    assert steps["loop_ns"] > 0
    assert steps["engine_ns"] > 0
    assert steps["python_ns"] == pytest.approx(steps["loop_ns"] - steps["engine_ns"])
    assert sum(steps["stages"].values()) == pytest.approx(1.0)
    assert steps["work"].keys() >= {"contacts", "constraints", "solver_iterations", "sensors"}
    assert steps["starts"]["window"]["nstart"] > 1
    assert [frame["backend"] for frame in row["frames"]] == ["egl", "osmesa"]
    for frame in row["frames"]:
        assert (frame["seconds"] is None) == bool(frame["detail"])
    again = mjbench("show", "--json", "-", cwd=tmp_path)
    assert json.loads(again.stdout)["results"] == [row]
    assert "constraint solver" in mjbench("show", cwd=tmp_path).stdout


@pytest.mark.parametrize("mode", [[], ["--habits"]], ids=" ".join)
def test_a_model_that_does_not_load_costs_its_row(
    tmp_path: Path, mode: list[str], inline: None
) -> None:
    (tmp_path / "broken.xml").write_text("<mujoco><nothing/></mujoco>")
    done = mjbench("profile", *mode, "broken.xml", "--json", "out.json", cwd=tmp_path)
    assert done.returncode == 2
    assert "mjbench: broken.xml: MuJoCo cannot load it" in done.stderr
    (row,) = json.loads((tmp_path / "out.json").read_text())["results"]
    assert (row["model"], row["status"]) == ("broken.xml", "input")
    assert row.get("steps") is row.get("costs") is None
