"""What `mjbench env` prints."""

import dataclasses
from typing import Any

import pytest
from example_environment_records import facts, record, steady
from rich.console import Console

from mjbench.environment.model_changes import ModelChange, Moment
from mjbench.environment.records import (
    EnvironmentRecord,
    PathSamples,
    PhysicsCheck,
    VectorForm,
    VectorSamples,
)
from mjbench.report import environment
from mjbench.report.environment_results import derive
from mjbench.status import Status


def printed(capsys: pytest.CaptureFixture[str], **fields: Any) -> str:
    console = Console(width=160, highlight=False, markup=False)
    environment.print_environment(console, derive(record(**fields)))
    return capsys.readouterr().out


def test_conclusions_come_first(capsys: pytest.CaptureFixture[str]) -> None:
    first, second, third, *_ = printed(capsys).strip().splitlines()
    assert first == (
        "Robot-v0: 60 % of env.step is physics; observation 30 %, rest of step 8 %, wrappers 2 %"
    )
    assert second == (
        "The same physics runs 2.00 times (2.00–2.00) as fast in a plain loop;"
        " 5.00 times (5.00–5.00) by rollout on 2 threads (open loop)."
    )
    assert third == (
        "AsyncVectorEnv of 2 takes 1.50 times (1.50–1.50) as many steps per second as one"
        " environment."
    )


def test_layers_paths_and_forms_are_in_tables(capsys: pytest.CaptureFixture[str]) -> None:
    text = printed(capsys)
    assert "Gymnasium: RobotEnv in TimeLimit; each step takes 5 steps of the engine" in text
    assert "100 steps with random actions (seed 0), 5 episodes, of 20 steps on average" in text
    assert "env.step takes 100 µs" in text
    assert "10,000 steps per second, 50,000 of the engine" in text
    assert "  mj_step" in text
    assert "adds 4.0 % to it (1 µs a call), which is subtracted" in text
    assert "A reset takes 200 µs: 10 µs for each step of an episode." in text
    assert "repeats 100 calls of the engine to the last bit. 96 steps of the environment" in text
    assert "250,000" in text
    assert "SyncVectorEnv" in text
    assert "batch_rollout" not in text  # this release lacks it
    assert "too busy" not in text
    assert "other programs were running" not in text


def test_a_layer_that_takes_nothing_is_not_told_from_none(
    capsys: pytest.CaptureFixture[str],
) -> None:
    (line,) = [line for line in printed(capsys).splitlines() if line.startswith("reward")]
    assert "< 0.1 %" in line
    assert "ns" not in line


def test_what_is_not_certain_is_no_conclusion(capsys: pytest.CaptureFixture[str]) -> None:
    wide = [50_000.0, 200_000.0] * 4
    slow = [PathSamples("python_loop", {}, True, Status.OK, "", wide)]
    forms = [VectorSamples(VectorForm.SYNC, 2, Status.OK, "", steady(1e5), steady(1e5))]
    text = printed(capsys, paths=slow, vectors=forms)
    assert "in a plain loop is not certainly faster than env.step." in text
    assert "No vectorised form is certainly faster than one environment here." in text


def test_layers_that_do_not_add_up_are_not_trusted(capsys: pytest.CaptureFixture[str]) -> None:
    assert "too busy to trust these shares" in printed(capsys, layers=record().layers[:-2])


@pytest.mark.parametrize(
    ("fields", "line"),
    [
        (
            {"check": PhysicsCheck(Status.DISAGREES, "qpos[0] is 1.0 …", 3), "paths": []},
            "NOT the same physics as a plain loop: qpos[0] is 1.0 …. Nothing is compared.",
        ),
        (
            {"check": PhysicsCheck(Status.UNAVAILABLE, "it writes qvel", 3), "paths": []},
            "No comparison with a plain loop: it writes qvel.",
        ),
        (
            {"check": PhysicsCheck(Status.OK, "", 9, 9, 1, False)},
            "It sets another control for each step of the engine; the comparison replays these",
        ),
        (
            {"facts": facts(entered=["mocap_pos", "xfrc_applied"])},
            "Beside controls, it writes mocap_pos, xfrc_applied between its steps.",
        ),
        (
            {"changes": [ModelChange("opt.gravity", Moment.STEP, 99)]},
            "It changes the model's opt.gravity between its steps, 99 times.",
        ),
        (
            {"changes": [ModelChange("body_mass", Moment.RESET, 1)]},
            "It changes the model's body_mass in a reset, once.",
        ),
        ({"facts": facts(repeats=False)}, "it does not do the same again."),
        ({"cores": [0.9] * 8}, "Threads got 0.9 of 2 cores: other programs were running."),
        ({"no_vectors": "only Gymnasium has them"}, "No vectorised forms: only Gymnasium has them"),
        (
            {"vectors": [VectorSamples(VectorForm.ASYNC, 2, Status.TIMEOUT, "no answer")]},
            "AsyncVectorEnv of 2: timeout: no answer",
        ),
        (
            {"paths": [PathSamples("rollout", {}, False, Status.DISAGREES, "qpos differs")]},
            "rollout: disagrees: qpos differs",
        ),
        ({"status": Status.TIMEOUT, "detail": "no answer"}, "Robot-v0: timeout: no answer"),
        ({"facts": facts(wrappers=())}, "RobotEnv without wrappers"),
        ({"facts": facts(frame_skip=None)}, "a varying number of steps of the engine"),
        ({"facts": facts(frame_skip=1)}, "takes 1 step of the engine"),
        ({"facts": facts(episode_nstep=None, nepisode=1)}, "one episode, which did not end"),
        ({"facts": facts(episode_nstep=None)}, "A reset takes 200 µs: no episode ended."),
    ],
)
def test_what_a_reader_must_know_is_said(
    fields: dict[str, Any], line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert line in printed(capsys, **fields)


def test_an_environment_that_could_not_be_timed_has_its_reason(
    capsys: pytest.CaptureFixture[str],
) -> None:
    failed = EnvironmentRecord(environment="Robot-v0", status=Status.FAILED, detail="it crashed")
    environment.print_environment(Console(width=120), derive(failed))
    assert capsys.readouterr().out.strip() == "Robot-v0: failed: it crashed"


def test_too_few_rounds_have_no_interval(capsys: pytest.CaptureFixture[str]) -> None:
    few = {
        field.name: list(getattr(record(), field.name))[:3]
        for field in dataclasses.fields(EnvironmentRecord)
        if field.name.endswith("_ns")
    }
    layers = [dataclasses.replace(layer, ns=layer.ns[:3]) for layer in record().layers]
    assert "too few rounds" in printed(capsys, **few, layers=layers, paths=[], vectors=[])
