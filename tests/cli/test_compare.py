"""`mjbench compare` as a user types it: once in processes of its own, else with invented races."""

import json
import re
from pathlib import Path
from typing import Any

import click.testing
import pytest
from click.testing import CliRunner
from commands import mjbench
from example_races import BATCH_STEP, ROLLOUT, THREADS, invent_comparisons

from mjbench.cli import cli
from mjbench.measuring.budget import AROUND_S
from mjbench.status import Status
from mjbench.verification.plan import WITHOUT_TIMER

# Small enough to be quick; what is tested is what the command says, not how fast it is.
QUICK = ["--nbatch", "6", "--nstep", "40", "--budget", "0.1", "--results", "runs"]


def invoke(*words: str) -> "click.testing.Result":
    return CliRunner().invoke(cli, ["compare", "cartpole", *words])


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def row(document: Any, path: str) -> Any:
    return next(r for r in document["results"] if r["path"] == path)


# in processes


def test_paths_are_verified_and_race_in_fresh_processes_and_show_prints_them_again(
    tmp_path: Path, contact_file: str
) -> None:
    words = ["--paths", "rollout,python_loop_hold", "--threads", "1", "--hold", "2", *QUICK]
    done = mjbench("compare", contact_file, *words, "--json", "out.json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    document = json.loads((tmp_path / "out.json").read_text())
    assert {r["status"] for r in document["results"]} == {"ok"}
    base = row(document, "python_loop")
    assert base["agrees"] is True
    assert base["speedup"]["estimate"] == 1.0
    assert base["steps_per_s"] == pytest.approx(1e9 / base["step_ns"])
    assert base["work"]["contacts"] > 0
    assert [a["loop"] for a in document["advice"]] == ["open", "closed"]
    assert done.stdout.index("For RL (closed loop): ") < done.stdout.index("speed-up  ")
    (file,) = (tmp_path / "runs").glob("*.jsonl")
    header, head, *rows, race = map(json.loads, file.read_text().splitlines())
    assert (header["type"], head["type"], race["type"]) == ("run", "model", "race")
    assert [r["path"] for r in rows] == [v["path"] for v in race["variants"]]
    assert all(len(launch["ns"][0]) == len(launch["variants"]) for launch in race["launches"])
    again = mjbench("show", str(file), "--json", "-", cwd=tmp_path)
    assert json.loads(again.stdout) == document


WRONG = {
    "ColdWarmStart": (None, 1, "0"),
    "OneStepFewer": ("time", 1, "0"),
    "ControlShifted": (None, 2, "0"),
    "LastUnstepped": ("time", 1, "5"),
    "LateError": (None, 30, "3"),
    # right when verified; each block has its own order of simulations
    "WrongWhenTimed": ("time", None, "[0-5]"),
}


def test_wrong_paths_are_caught_named_and_shown_without_a_speed(
    tmp_path: Path, contact_file: str
) -> None:
    names = {f"wrong_paths:{name}": expected for name, expected in WRONG.items()}
    words = ["--paths", ",".join([*names, "wrong_paths:Right"]), *QUICK]
    done = mjbench("compare", contact_file, *words, "--json", "out.json", cwd=tmp_path)
    assert done.returncode == 1
    document = json.loads((tmp_path / "out.json").read_text())
    for path, (field, step, culprit) in names.items():
        result = row(document, path)
        assert (result["status"], result["agrees"]) == ("disagrees", False), path
        assert result["step_ns"] is result["speedup"] is result["steps_per_s"] is None
        assert re.search(f"simulation {culprit} ", result["agreement"])
        if field:
            assert result["agreement"].removeprefix("in a timed block: ").startswith(field)
        if step:
            assert f"after step {step}:" in result["agreement"]
        assert path not in [a["path"] for a in document["advice"]]
        assert result["agreement"] in done.stdout
    assert done.stdout.count(" NO") == len(names)
    for path in ("python_loop", "wrong_paths:Right"):
        assert row(document, path)["agrees"] is True
        assert row(document, path)["step_ns"] is not None


# with invented races


def test_json_to_stdout_is_one_document_and_nothing_else(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    invent_comparisons(monkeypatch)
    done = invoke("--json", "-")
    document = json.loads(done.stdout)
    assert document["schema"] == 1
    assert "rollout" in done.stderr
    (file,) = (folder / "results/runs").glob("*.jsonl")
    again = CliRunner().invoke(cli, ["show", str(file), "--json", "-"])
    assert json.loads(again.stdout) == document


def test_in_a_pipe_phases_go_to_standard_error_and_one_table_to_standard_output(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    invent_comparisons(monkeypatch)
    done = invoke("--threads", "2", "--nbatch", "2,300")
    assert done.stderr.count("cartpole: racing 11 paths, about 20 s\n") == 2
    assert "racing" not in done.stdout
    assert (done.stderr.count("ns/step"), done.stdout.count("ns/step")) == (0, 1)


def test_the_code_of_what_is_advised_is_printed_once_and_only_if_asked_for(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    invent_comparisons(monkeypatch)
    done = invoke("--threads", "2")
    assert "# rollout" not in done.stdout
    assert "--code prints" in done.stdout
    done = invoke("--threads", "2", "--code")
    assert done.stdout.count(f"# {ROLLOUT}") == 1
    assert done.stdout.count(f"# {BATCH_STEP}") == 1
    assert f"# {THREADS}" not in done.stdout


def test_sizes_are_measured_one_after_the_other_and_shown_in_one_table(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plans = invent_comparisons(monkeypatch)
    done = invoke("--nbatch", "2,300", "--json", "out.json")
    assert [plan.nbatch for plan in plans] == [2, 300]
    assert done.stdout.count("ns/step") == 1
    for size in ("2 simulations", "300 simulations"):
        assert f"For RL (closed loop), {size}: Batch.step" in done.stdout
    document = json.loads(Path("out.json").read_text())
    assert [a["nbatch"] for a in document["advice"]] == [2, 2, 300, 300]


@pytest.mark.parametrize(
    ("words", "budget_s"),
    [([], 23.0), (["--quick"], 5.0), (["--budget", "60s"], pytest.approx(60 - AROUND_S, abs=9))],
)
def test_the_budget_bounds_each_model(
    folder: Path, monkeypatch: pytest.MonkeyPatch, words: list[str], budget_s: float
) -> None:
    plans = invent_comparisons(monkeypatch)
    assert invoke(*words).exit_code == 0
    assert [plan.budget_s for plan in plans] == [budget_s]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--budget", "0"], "'0' is not a time such as 60s, above 0"),
        (["--quick", "--budget", "3s"], "--quick is a short --budget: give one of the two"),
    ],
)
def test_a_budget_that_is_none_or_given_twice_is_refused(words: list[str], message: str) -> None:
    done = invoke(*words)
    assert done.exit_code == 2
    assert message in done.output


def test_scaling_lets_more_threads_and_chunks_take_part_and_says_how_many_suffice(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plans = invent_comparisons(monkeypatch)
    done = invoke("--scaling", "--threads", "1,2,4", "--option", "chunk=1,8", "--json", "out.json")
    assert done.exit_code == 0, done.output
    (plan,) = plans
    assert {variant.path for variant in plan.variants} == {"python_loop", "rollout", "batch_step"}
    assert WITHOUT_TIMER in plan.variants
    options = [variant.options for variant in plan.variants if variant.path == "rollout"]
    sizes = {(each["threads"], each.get("chunk")) for each in options}
    assert sizes == {(1, None), (2, 1), (2, 8), (4, 1), (4, 8)}
    document = json.loads(Path("out.json").read_text())
    assert [(t["path"], t["nthread"], t["most_tried"]) for t in document["threads"]] == [
        ("rollout", 1, 4),
        ("batch_step", 1, 4),
    ]
    assert "mujoco.rollout: no number of threads up to 4 is certainly faster" in done.stdout


def test_a_model_that_fails_after_its_first_launches_is_not_green(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    invent_comparisons(monkeypatch, status=Status.FAILED, detail="it failed")
    done = invoke()
    assert done.exit_code == 3
    assert "it failed" in done.stdout
