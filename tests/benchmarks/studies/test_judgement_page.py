"""The page of judgements, and its tally."""

from dataclasses import replace
from pathlib import Path

from committed_trials import RUNS
from example_records import JUDGED, measurement

from benchmarks.studies import judgement_page, judgements, tally_file
from benchmarks.studies.judgement_tally import JudgedModel, JudgementTally, load
from benchmarks.studies.page_part import of_lines
from mjbench.commands.show.kinds import RECORD_TYPES
from mjbench.results import runs
from mjbench.simulation.accelerated_judgement import EngineAnswer
from mjbench.status import Status
from mjbench.verification.records import VariantRecord

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


def test_every_committed_run_judges_a_model_as_the_table_does() -> None:
    table = {
        (row.model, row.path): row.judgement.answer
        for row in load(judgements.TALLY).rows
        if row.package == "shipped" and row.judgement is not None
    }
    cited = {
        (file.name, row.model, row.path): row.judgement.answer
        for file in RUNS.glob("*.jsonl")
        for row in runs.load(file, RECORD_TYPES).of_type(VariantRecord)
        if row.judgement is not None
    }
    assert cited
    assert cited == {key: table.get(key[1:]) for key in cited}


def test_a_model_that_is_judged_again_replaces_its_row(tmp_path: Path) -> None:
    again = tally().with_row(JudgedModel.of("p", replace(REFUSED, detail="another")))
    file = tmp_path / "tally.json"
    tally_file.write(file, again)
    assert [row.detail for row in load(file).rows] == ["", "another"]
