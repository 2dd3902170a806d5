"""A planner in a closed loop: all paths must give the same plan, to the last bit."""

import json
from pathlib import Path

from commands import mjbench

from mjbench.comparison import planning_run
from mjbench.comparison.plan import Variant
from mjbench.comparison.planning_run import PlanningRequest
from mjbench.comparison.sampling_planners import Algorithm, PlannerSettings
from mjbench.simulation import models
from mjbench.status import Status


def test_mppi_swings_up_the_cartpole_through_rollout_and_batch_with_the_same_states() -> None:
    variants = (
        Variant("python_loop", {}),
        Variant("rollout", {"threads": 2, "pool": "kept"}),
        Variant("batch_rollout", {"threads": 2, "data": "shared"}),
    )
    source = models.resolve("cartpole")
    settings = PlannerSettings(Algorithm.MPPI, samples=32, knots=25)
    rows = planning_run.run(PlanningRequest(source, variants, settings, hold=20, duration_s=3.0))
    assert [row.status for row in rows if row.status != Status.UNAVAILABLE] == [Status.OK] * len(
        [row for row in rows if row.status != Status.UNAVAILABLE]
    )
    assert rows[1].status == Status.OK
    assert all(row.achieved for row in rows)
    assert len({row.state_digest for row in rows}) == 1
    assert all(row.plans_per_s for row in rows if row.status == Status.OK)


def test_a_path_that_returns_other_states_disagrees(tmp_path: Path, inline: None) -> None:
    words = ["--samples", "4", "--knots", "4", "--hold", "5", "--duration", "0.1s"]
    paths = "wrong_paths:Right,wrong_paths:WrongMiddle,wrong_paths:Memo,wrong_paths:FinalOnly"
    done = mjbench("plan", "--paths", paths, *words, "--json", "out.json", cwd=tmp_path)
    assert done.returncode == 1, done.stderr
    rows = json.loads((tmp_path / "out.json").read_text())["results"]
    assert {row["path"]: row["status"] for row in rows} == {
        "python_loop": "ok",
        "wrong_paths:Right": "ok",
        "wrong_paths:WrongMiddle": "disagrees",
        "wrong_paths:Memo": "disagrees",
        "wrong_paths:FinalOnly": "unavailable",
    }
    assert "differs after step 3" in done.stdout
    assert "cartpole: fastest here is " in done.stdout


def test_several_sizes_of_plans_are_tried(tmp_path: Path, inline: None) -> None:
    words = ["--samples", "2,4", "--knots", "3,5", "--hold", "5", "--duration", "0.1s"]
    words += ["--paths", "rollout", "--threads", "1,2"]
    done = mjbench("plan", *words, "--json", "out.json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    rows = json.loads((tmp_path / "out.json").read_text())["results"]
    sizes = [(row["samples"], row["horizon"]) for row in rows if row["path"] == "python_loop"]
    assert sizes == [(2, 15), (2, 25), (4, 15), (4, 25)]
    assert len(rows) == 4 * 4  # rollout with two threads keeps its pool, or has a new one
    assert "cartpole, by the size of the plan" in done.stdout
    again = mjbench("show", "--json", "-", cwd=tmp_path)
    assert json.loads(again.stdout)["results"] == rows
    assert "cartpole, by the size of the plan" in again.stderr


def test_the_budget_ends_the_loop_and_a_finished_run_is_not_measured_again(
    tmp_path: Path, inline: None
) -> None:
    words = ["plan", "--nbatch", "2", "--knots", "2", "--paths", "rollout", "--budget", "0.001"]
    done = mjbench(*words, "--json", "out.json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "ended by the budget, by mppi with 2 samples × 40 steps, 4 plans" in done.stdout
    (file,) = (tmp_path / "results/runs").glob("*.jsonl")
    before = file.read_text()
    again = mjbench(*words, "--resume", str(file), "--json", "again.json", cwd=tmp_path)
    assert again.returncode == 0, again.stderr
    assert (tmp_path / "again.json").read_text() == (tmp_path / "out.json").read_text()
    assert file.read_text() == before


def test_a_model_without_controls_is_refused_in_a_line(tmp_path: Path, inline: None) -> None:
    done = mjbench("plan", "cube_table", "--duration", "0.1s", cwd=tmp_path)
    assert done.returncode == 2
    assert "has no controls to plan" in done.stderr
