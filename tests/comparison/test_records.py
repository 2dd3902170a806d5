"""Records of a comparison, as run files hold them."""

import json
from pathlib import Path

from example_records import JUDGED

from mjbench.comparison.records import RECORD_TYPES, MeasurementRecord
from mjbench.host import machine
from mjbench.simulation.judgement import Answer, Precision
from mjbench.status import Status
from mjbench.store import run_file, runs

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
    file = run_file.RunFile.create(
        folder, runs.RunHeader(runs.SCHEMA, "compare", machine.describe(), {})
    )
    file.append(RECORD)
    file.close()
    return file.path


def test_a_record_comes_back_as_it_was(tmp_path: Path) -> None:
    run = runs.load(stored(tmp_path), RECORD_TYPES)
    assert run.of_type(MeasurementRecord) == [RECORD]


def test_a_path_that_an_earlier_version_checked_is_not_judged(tmp_path: Path) -> None:
    path = stored(tmp_path)
    header, line = path.read_text().splitlines()
    record = json.loads(line)
    del record["judgement"]
    record["check"] = {"precision": "float32", "received": True, "unconstrained_steps": 0}
    path.write_text(f"{header}\n{json.dumps(record)}\n")
    (read,) = runs.load(path, RECORD_TYPES).of_type(MeasurementRecord)
    assert read.judgement is not None
    assert read.judgement.answer == Answer.NOT_JUDGED
    assert "earlier version" in read.judgement.reason
