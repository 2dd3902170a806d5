"""Reports of environments."""

import pytest
from example_environment_records import record

from mjbench.environment.records import EnvironmentRecord, PhysicsCheck
from mjbench.report import charts, environment
from mjbench.report.content import Tone
from mjbench.status import Status


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
