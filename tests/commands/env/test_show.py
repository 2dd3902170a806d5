"""What `mjbench env` prints."""

import dataclasses
from typing import Any

import pytest
from example_environment_records import facts, record, steady

from mjbench.commands.env import show as environment
from mjbench.commands.env.construction import ReleaseMismatch
from mjbench.commands.env.layers import Layer
from mjbench.commands.env.recording import ModelChange, Moment
from mjbench.commands.env.repetition import FieldDifference
from mjbench.commands.env.result import (
    EnvironmentRecord,
    PathSamples,
    PhysicsCheck,
    VectorForm,
    VectorSamples,
)
from mjbench.commands.env.timer import LayerSamples
from mjbench.results import charts, terminal
from mjbench.results.content import Tone
from mjbench.status import Status


def printed(**fields: Any) -> str:
    return terminal.text_of(environment.sections([record(**fields)]))


def test_conclusions_come_first() -> None:
    first, second, third, *_ = printed().strip().splitlines()
    assert first == (
        "Robot-v0: 60 % of env.step is physics; observation 30 %, rest of step 8 %, wrappers 2 %"
    )
    assert second == (
        "The same physics runs 2.00 times (2.00–2.00) as fast in a plain loop;"
        " 5.00 times (5.00–5.00) with mujoco.rollout on 2 threads (open loop)."
    )
    assert third == (
        "AsyncVectorEnv of 2 takes 1.50 times (1.50–1.50) as many steps per second as one"
        " environment."
    )


def test_layers_paths_and_forms_are_in_tables() -> None:
    text = printed()
    assert "Gymnasium: RobotEnv in TimeLimit; each step takes 5 steps of the engine" in text
    assert "100 steps with random actions (seed 0), 5 episodes, of 20 steps on average" in text
    assert "env.step takes 100 µs" in text
    assert "10,000 steps per second, 50,000 of the engine" in text
    assert "  – mj_step" in text
    assert "adds 4.0 % to it (1 µs a call), which is subtracted" in text
    assert (
        "env.reset takes 200 µs (199 µs–201 µs), as long as 2 steps: 9.1 % of an episode of 20"
        " steps."
    ) in text
    assert "repeats 100 calls of the engine to the last bit. 96 steps of the environment" in text
    assert "250,000" in text
    assert "SyncVectorEnv" in text
    assert "batch_rollout" not in text  # this release lacks it
    assert "too busy" not in text
    assert "other programs were running" not in text


def test_a_layer_that_takes_nothing_is_not_told_from_none() -> None:
    (line,) = [line for line in printed().splitlines() if line.startswith("reward")]
    assert "< 0.1 %" in line
    assert "ns" not in line


def test_what_is_not_certain_is_no_conclusion() -> None:
    wide = [50_000.0, 200_000.0] * 4
    slow = [PathSamples("python_loop", {}, True, Status.OK, "", wide)]
    forms = [VectorSamples(VectorForm.SYNC, 2, Status.OK, "", steady(1e5), steady(1e5))]
    text = printed(paths=slow, vectors=forms)
    assert "in a plain loop is not certainly faster than env.step." in text
    assert "No vectorised form is certainly faster than one environment here." in text


def test_layers_that_do_not_add_up_are_not_trusted() -> None:
    assert "too busy to trust these shares" in printed(layers=record().layers[:-2])


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
            "Beside controls, it writes mocap_pos and xfrc_applied between its steps.",
        ),
        (
            {"changes": [ModelChange("opt.gravity", Moment.STEP, 99)]},
            "It changes the model's opt.gravity between its steps, 99 times.",
        ),
        (
            {"changes": [ModelChange("body_mass", Moment.RESET, 1)]},
            "It changes the model's body_mass in a reset, once.",
        ),
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
        (
            {"facts": facts(episode_nstep=None)},
            "as long as 2 steps: less than 2.0 % of an episode, as none ended within 100 steps.",
        ),
        (
            {"facts": facts(dm_control_release=ReleaseMismatch("3.17.0", "4.0.0"))},
            "dm_control is built for MuJoCo 3.17.0, and 4.0.0 is installed; install it with",
        ),
    ],
)
def test_what_a_reader_must_know_is_said(fields: dict[str, Any], line: str) -> None:
    assert line in printed(**fields)


OBSERVATION = FieldDifference("observation", False, [0, 1, 2], 17, 17)
QPOS = FieldDifference("qpos", True, [6], 1, 9)


@pytest.mark.parametrize(
    ("unrepeated", "line"),
    [
        ([OBSERVATION], "observation differs in another pass; its physics is the same."),
        (
            [OBSERVATION, QPOS],
            "observation and qpos[6] differ in another pass, so its physics is not compared.",
        ),
        (
            [OBSERVATION] * 6,
            "observation, observation, observation, observation and 2 more differ in another pass;"
            " its physics is the same.",
        ),
        ([], "it does not do the same again."),
    ],
)
def test_what_does_not_repeat_is_named_once_and_first(
    unrepeated: list[FieldDifference], line: str
) -> None:
    check = PhysicsCheck(Status.UNAVAILABLE, "its physics is not the same again", 100)
    fields = {"check": check, "paths": []} if QPOS in unrepeated else {}
    text = printed(facts=facts(repeats=False, unrepeated=unrepeated), **fields)
    second = text.strip().splitlines()[1]
    assert second.startswith("With the same seed and actions, ")
    assert second.endswith(line)
    assert "again" not in text.replace(second, "")


def test_the_costliest_wrapper_is_named_where_wrappers_take_much() -> None:
    costly = LayerSamples(Layer.WRAPPERS, "NormalizeObservation", 1.0, 0.0, 0.0, steady(100_000.0))
    layers = [*record().layers, costly]
    caution, first, *_ = printed(layers=layers).strip().splitlines()
    assert caution.startswith("The layers add up to 200.0 % of a step")
    assert "wrappers 51 % (NormalizeObservation 50 %)" in first


def test_what_processes_add_to_a_step_is_said_where_their_cores_are_known() -> None:
    assert "to pass actions" not in printed()
    slow = VectorSamples(VectorForm.ASYNC, 4, Status.OK, "", steady(9e4), steady(1e5), 2)
    text = printed(vectors=[slow])
    assert (
        "A step in AsyncVectorEnv of 4 takes 90 µs: 50 µs for env.step on 2 cores, and 40 µs to"
        " pass actions and results between processes and to wait."
    ) in text
    fast = VectorSamples(VectorForm.ASYNC, 4, Status.OK, "", steady(4e4), steady(1e5), 2)
    assert "to pass actions" not in printed(vectors=[fast])


def test_an_environment_that_could_not_be_timed_has_its_reason() -> None:
    failed = EnvironmentRecord(environment="Robot-v0", status=Status.FAILED, detail="it crashed")
    text = terminal.text_of(environment.sections([failed]))
    assert text == "Robot-v0: failed: it crashed"


def test_too_few_rounds_have_no_interval() -> None:
    few = {
        field.name: list(getattr(record(), field.name))[:3]
        for field in dataclasses.fields(EnvironmentRecord)
        if field.name.endswith("_ns")
    }
    layers = [dataclasses.replace(layer, ns=layer.ns[:3]) for layer in record().layers]
    assert "too few rounds" in printed(**few, layers=layers, paths=[], vectors=[])


# sections


def test_layers_are_drawn_and_tables_hold_the_rest() -> None:
    (section,) = environment.sections([record()])
    assert section.conclusions[0].text.startswith("Robot-v0: 60 % of env.step is physics")
    (figure,) = section.figures
    layers = [row[0] for row in figure.data.rows]
    assert layers[:2] == ["physics", "observation"]
    titles = [table.title for table in section.tables]
    assert titles == [
        "Layers and functions of a step",
        "The same physics without the environment",
        "Several environments at once, resets included",
    ]
    assert [row[0] for row in section.tables[1].rows] == ["python_loop", "rollout", "batch_step"]
    assert any("env.reset takes 200 µs" in note for note in section.facts)
    pytest.importorskip("vl_convert")
    assert "observation" in charts.svg(figure.specification)


def test_an_environment_without_a_comparison_has_no_table_of_paths() -> None:
    check = PhysicsCheck(Status.UNAVAILABLE, "the environment writes qvel", 3)
    (section,) = environment.sections([record(check=check, paths=[], vectors=[])])
    assert [table.title for table in section.tables] == ["Layers and functions of a step"]
    assert any("writes qvel" in note for note in section.notes)


def test_what_went_wrong_comes_first() -> None:
    failed = EnvironmentRecord(environment="R", status=Status.FAILED, detail="it crashed")
    other = record(check=PhysicsCheck(Status.DISAGREES, "qpos[0] is 1.0 …", 3), paths=[])
    first, second = environment.sections([failed, other])
    assert first.conclusions[0].tone == second.conclusions[0].tone == Tone.BAD
    assert first.conclusions[0].text == "R: failed: it crashed"
    assert "qpos[0]" in second.conclusions[0].text


def test_the_fields_that_a_reset_leaves_are_named_with_what_restores_them() -> None:
    left = ["act", "qacc_warmstart"]
    text = printed(facts=facts(repeats=False, unrepeated=[OBSERVATION], left_by_reset=left))
    assert "Its reset leaves act and qacc_warmstart as they were: mujoco.mj_resetData" in text
