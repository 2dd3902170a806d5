"""Results are derived from records; here the records are made up and the truth is known."""

from typing import Any

import pytest

from mjbench.report import results


def records(**rows: dict[str, Any]) -> list[dict[str, Any]]:
    head = {"type": "model", "model": "m", "facts": {"timestep": 0.002}, "cores_had": [1.5, 1.9]}
    common = {
        "type": "measurement", "model": "m", "options": {}, "status": "ok", "detail": "",
        "agrees": True, "agreement": "bit-identical", "closed_loop": False, "nbatch": 10,
        "nstep": 100, "hold": 1, "diverged": 0, "work": {}, "snippet": "pass",
    }  # fmt: skip
    return [head, *({**common, "path": path, **row} for path, row in rows.items())]


def test_speed_follows_from_samples_and_steps() -> None:
    (base,) = results.of_model(records(python_loop={"samples_s": [0.003, 0.001, 0.002]}))
    assert base["step_ns"] == {"median": pytest.approx(2000), "min": pytest.approx(1000)}
    assert base["steps_per_s"] == pytest.approx(5e5)
    assert base["realtime_factor"] == pytest.approx(1000)
    assert base["speedup"] == {"median": 1.0, "low": None, "high": None}


def test_a_path_that_disagrees_or_failed_has_no_speed() -> None:
    for row in ({"agrees": False, "status": "disagrees"}, {"status": "crashed"}):
        made = records(python_loop={"samples_s": [1.0]}, rollout={"samples_s": [0.5], **row})
        found = results.of_model(made)[1]
        assert found["step_ns"] is found["speedup"] is found["steps_per_s"] is None


def test_advice_names_the_fastest_open_loop_and_the_fastest_closed_loop_path() -> None:
    made = records(
        python_loop={"samples_s": [1.0] * 7, "closed_loop": True},
        rollout={"samples_s": [0.25] * 7},
        batch_step={"samples_s": [0.5] * 7, "closed_loop": True},
        threads={"samples_s": [0.1] * 7, "agrees": False, "status": "disagrees"},
    )
    found = results.advice(results.of_model(made))
    assert [(a["loop"], a["path"]) for a in found] == [
        ("open", "rollout"),
        ("closed", "batch_step"),
    ]
    assert found[0]["speedup"] == pytest.approx(4.0)


def test_advice_prefers_the_simpler_of_two_equally_fast_paths() -> None:
    made = records(
        python_loop={"samples_s": [1.000] * 7, "closed_loop": True},
        python_loop_hold={"samples_s": [0.995] * 7, "closed_loop": True},
    )
    assert {a["path"] for a in results.advice(results.of_model(made))} == {"python_loop"}


def test_the_cores_a_run_had_are_the_median_of_its_calibrations() -> None:
    assert results.cores_had(records()[0]) == pytest.approx(1.7)
    assert results.cores_had({"cores_had": []}) is None


def swept(path: str, nbatch: int, ns: float, **more: Any) -> dict[str, Any]:
    common = {"model": "m", "path": path, "options": {}, "nbatch_asked": nbatch, "nbatch": nbatch}
    return common | {"steps_per_s": 1e9 / ns, "step_ns": {"median": ns}} | more


def test_the_crossover_is_the_size_from_which_on_a_path_stays_ahead() -> None:
    rows = [
        *(swept("python_loop", n, 100.0) for n in (1, 16, 64, 256)),
        *(swept("rollout", n, 50.0) for n in (1, 16, 64, 256)),
    ]
    speeds = {1: 900.0, 16: 49.0, 64: 51.0, 256: 10.0}
    rows += [swept("mjx", n, ns, precision="float32") for n, ns in speeds.items()]
    rows += [swept("mjx64", n, 60.0, precision="float64") for n in speeds]
    first, second = results.crossovers(rows)
    assert (first["path"], first["nbatch"], first["rival"]["path"]) == ("mjx", 256, "rollout")
    assert (second["path"], second["nbatch"], second["largest"]) == ("mjx64", None, 256)
    for found in rows:
        found["check"] = {"free_steps": 0} if "precision" in found else None
    assert results.crossovers(rows) == []  # held to nothing
