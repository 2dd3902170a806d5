"""The crossover of Ray: what is tallied, and the page that is written from it."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.studies import ray_crossover, ray_page
from benchmarks.studies.page_part import of_lines
from benchmarks.studies.ray_tally import (
    CallWork,
    Overtaking,
    PathTime,
    RayCost,
    RayModel,
    RaySize,
    RayTally,
    load,
)
from mjbench.errors import InputError
from mjbench.report.path_speedups import PathResult
from mjbench.status import Status
from mjbench.store.runs import to_json

SMALL, LARGE = CallWork(steps=40, loop_ms=0.2), CallWork(steps=4000, loop_ms=20.0)


def times(*ms: float) -> list[PathTime]:
    columns = [("python_loop", 1), ("rollout", 2), ("ray", 2)]
    return [PathTime(path, n, each) for (path, n), each in zip(columns, ms, strict=True)]


MODEL = RayModel(
    model="m",
    step_us=5.0,
    nstep=20,
    sizes=[RaySize(2, 20, times(0.2, 0.15, 3.0)), RaySize(200, 20, times(20.0, 8.0, 10.0))],
    crossovers=[
        Overtaking("python_loop", 1, LARGE, LARGE, 2.0),
        Overtaking("rollout", 2, None, LARGE, 0.8),
    ],
)
TALLY = RayTally(
    date="2026-01-02",
    processor="a processor",
    usable_cores=2,
    mujoco="4.0.0",
    ray="2.60.0",
    cost=RayCost(3.0, 1.5, 0.02, 250 << 20, 60 << 20),
    models=[MODEL],
)


def result(path: str, step_ns: float | None, **options: int) -> PathResult:
    return PathResult(
        model="m",
        path=path,
        options=options,
        status=Status.OK if step_ns else Status.FAILED,
        detail="" if step_ns else "why",
        nbatch=2,
        nstep=20,
        step_ns=step_ns if step_ns else None,
    )


def test_a_call_of_a_path_takes_as_long_as_that_of_its_fastest_variant() -> None:
    results = [result("rollout", 50.0, threads=2), result("rollout", 25.0, threads=2, chunk=1)]
    assert ray_crossover._times(results) == [PathTime("rollout", 2, pytest.approx(1e-3))]


def test_a_path_that_fails_ends_the_measurement_in_one_line() -> None:
    with pytest.raises(InputError, match="m: ray: failed: why"):
        ray_crossover._times([result("ray", None)])


def test_the_page_says_first_that_rollout_needs_no_ray() -> None:
    lines = list(ray_page.lines(TALLY))
    assert lines[0].startswith("On one machine, Ray does not pay: ")
    assert (
        "Ray actors beat a plain loop on 1 of 1 models, once a call takes 20 ms of its work"
        in lines[0]
    )
    assert "| m | 5 | 20 ms (4,000 steps) | *never* up to 20 ms (0.80×) |" in lines


def test_the_page_names_the_models_on_which_ray_is_ahead() -> None:
    crossovers = [replace(row, least=LARGE, share=1.25) for row in MODEL.crossovers]
    ahead = replace(TALLY, models=[MODEL, replace(MODEL, model="n", crossovers=crossovers)])
    (line,) = [line for line in ray_page.lines(ahead) if "on 1 of 2 models" in line]
    assert "n (1.25 of its speed at the largest call)" in line


def test_the_page_is_written_from_the_committed_tally() -> None:
    tally = load(ray_crossover.TALLY)
    assert ray_page.PART.text() == of_lines(ray_page.lines(tally))
    assert json.loads(ray_crossover.TALLY.read_text(encoding="utf-8")) == to_json(tally)
    assert [model.model for model in tally.models] == [case.model for case in ray_crossover.CASES]


def test_the_command_refuses_a_file_that_is_no_tally(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    tally = tmp_path / "ray.json"
    monkeypatch.setattr(ray_crossover, "TALLY", tally)
    assert ray_crossover.main(["--page"]) == 2
    assert "ray.json: No such file or directory" in capsys.readouterr().err
    tally.write_text('{"models": []}')
    assert ray_crossover.main(["--page"]) == 2
    assert "is not a tally of calls of Ray" in capsys.readouterr().err
    assert ray_crossover.main(["no_such_model"]) == 2
