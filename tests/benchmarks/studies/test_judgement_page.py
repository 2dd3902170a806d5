"""The page of judgements, and its tally."""

from dataclasses import replace
from pathlib import Path

from example_records import JUDGED, measurement

from benchmarks.studies import judgement_page, judgements, tally_file
from benchmarks.studies.judgement_tally import JudgedModel, JudgementTally, load
from benchmarks.studies.page_part import of_lines
from mjbench.simulation.accelerated_judgement import EngineAnswer
from mjbench.status import Status

CLOSE = replace(JUDGED, answer=EngineAnswer.CLOSE, reason="contacts: box–box")
REFUSED = measurement(path="mjx", status=Status.UNAVAILABLE, detail="MJX does not take this model")


def tally() -> JudgementTally:
    empty = JudgementTally("4.0.0", 16, 50, ())
    close = measurement(path="warp", judgement=CLOSE, versions={"mujoco-warp": "4.0.0"})
    return empty.with_row(JudgedModel.of("shipped", close)).with_row(JudgedModel.of("p", REFUSED))


def test_the_page_has_the_answers_and_the_versions_that_computed() -> None:
    text = of_lines(judgement_page.lines(tally()))
    assert "Of 2 pairs of a model and a path: 1 close, 1 unavailable." in text
    assert "mujoco 4.0.0, mujoco-warp 4.0.0" in text
    assert "| m | close |" in text


def test_the_page_is_that_of_the_committed_tally() -> None:
    assert judgement_page.PART.text() == of_lines(judgement_page.lines(load(judgements.TALLY)))


def test_a_model_that_is_judged_again_replaces_its_row(tmp_path: Path) -> None:
    again = tally().with_row(JudgedModel.of("p", replace(REFUSED, detail="another")))
    file = tmp_path / "tally.json"
    tally_file.write(file, again)
    assert [row.detail for row in load(file).rows] == ["", "another"]
