"""What a comparison says of paths that were judged."""

from dataclasses import replace

import pytest
from example_records import JUDGED, measurement, model_record

from mjbench.commands.compare.judgement_notes import (
    judgement_conclusion,
    judgement_tables,
    version_lines,
)
from mjbench.commands.compare.results import ModelResults, PathResult
from mjbench.commands.compare.show import model_section
from mjbench.results.content import Section
from mjbench.simulation.accelerated_judgement import EngineAnswer, Precision

VERSIONS = {"mujoco": "4.0.0", "mujoco-mjx": "3.17.0", "mujoco-warp": "4.0.0"}


def compared(answer: EngineAnswer = EngineAnswer.YES, reason: str = "") -> ModelResults:
    """Return the results of the plain loop, and of MJX at half its speed."""
    mjx = measurement(
        path="mjx",
        precision=Precision.FLOAT32,
        judgement=replace(JUDGED, answer=answer, reason=reason),
        versions=VERSIONS,
        samples_s=[0.2] * 3,
        compile_s=3.0,
        device="cpu",
    )
    return ModelResults(model_record(), (measurement(samples_s=[0.1] * 3), mjx))


def mjx_of(results: ModelResults) -> PathResult:
    return next(result for result in results.results if result.path == "mjx")


def section(answer: EngineAnswer = EngineAnswer.YES, reason: str = "") -> Section:
    return model_section([compared(answer, reason)])


@pytest.mark.parametrize(
    ("answer", "reason", "begin"),
    [
        (EngineAnswer.YES, "", "MJX in float32 computes what C does"),
        (
            EngineAnswer.CLOSE,
            "contacts: box–box",
            "MJX in float32 computes what C does but for contacts",
        ),
        (EngineAnswer.NOT_JUDGED, "why", "MJX in float32 is not judged: why"),
    ],
)
def test_the_conclusion_says_whether_it_computes_what_c_does(
    answer: EngineAnswer, reason: str, begin: str
) -> None:
    text = judgement_conclusion(mjx_of(compared(answer, reason)))
    assert text is not None
    assert text.startswith(begin)
    assert any(each.sentence == text for each in section(answer, reason).conclusions)


def test_what_disagrees_is_said_once_elsewhere() -> None:
    assert judgement_conclusion(mjx_of(compared(EngineAnswer.NO, "run: it ends elsewhere"))) is None


def test_each_part_shows_the_measure_that_is_nearest_to_its_limit() -> None:
    parts, contacts = judgement_tables([mjx_of(compared())])
    assert parts.texts[0][3] == "a step without constraints 1e-07 (limit 0.0001)"
    assert parts.texts[2][3] == "forces of the solution 1e-05 (limit 0.0001, C 1e-09)"
    assert contacts.texts == [
        ["mjx", "plane–sphere", "8", "4.0", "4.0", "0.000001", "0", "0.0001 %", "0.001 %", "yes"]
    ]


def test_an_engine_that_is_older_than_mujoco_is_named_once() -> None:
    (line,) = version_lines([mjx_of(compared())] * 2)
    assert line.count("mujoco-mjx 3.17.0 is older than MuJoCo 4.0.0") == 1
    assert "mujoco-warp 4.0.0 is older" not in line
