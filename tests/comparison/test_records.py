"""Records of a comparison, as run files hold them."""

import json
from pathlib import Path

import pytest
from example_records import JUDGED

from mjbench.comparison.records import RECORD_TYPES, MeasurementRecord
from mjbench.host import machine
from mjbench.simulation.accelerated_judgement import EngineAnswer, Precision
from mjbench.status import Status
from mjbench.store import run_writer, runs

RECORD = MeasurementRecord(
    model="m",
    path="mjx",
    options={},
    status=Status.OK,
    precision=Precision.FLOAT32,
    judgement=JUDGED,
    samples_s=[],
)


def stored(folder: Path) -> Path:
    file = run_writer.RunFile.create(
        folder, runs.RunHeader(runs.SCHEMA, "compare", machine.describe(), {})
    )
    file.append(RECORD)
    file.close()
    return file.path


def test_a_record_comes_back_as_it_was(tmp_path: Path) -> None:
    run = runs.load(stored(tmp_path), RECORD_TYPES)
    assert run.of_type(MeasurementRecord) == [RECORD]


@pytest.mark.parametrize(
    ("stored_before", "check", "answer", "reason"),
    [
        ({"agrees": True}, {"contact_steps": 3}, EngineAnswer.NOT_JUDGED, "earlier version"),
        ({"agrees": True}, {"contact_steps": 0}, EngineAnswer.YES, ""),
        (
            {"agrees": False, "status": "disagrees", "detail": "it ends elsewhere"},
            {"contact_steps": 0},
            EngineAnswer.NO,
            "it ends elsewhere",
        ),
    ],
)
def test_what_an_earlier_version_checked_is_judged_as_far_as_its_rules_went(
    stored_before: dict[str, object],
    check: dict[str, object],
    answer: EngineAnswer,
    reason: str,
    tmp_path: Path,
) -> None:
    path = stored(tmp_path)
    header, line = path.read_text().splitlines()
    record = {**json.loads(line), **stored_before}
    del record["judgement"]
    record["check"] = {"precision": "float32", "unconstrained_steps": 9, **check}
    path.write_text(f"{header}\n{json.dumps(record)}\n")
    (read,) = runs.load(path, RECORD_TYPES).of_type(MeasurementRecord)
    assert read.judgement is not None
    assert (read.judgement.answer, read.agrees) == (answer, read.judgement.agrees)
    assert reason in read.judgement.reason
