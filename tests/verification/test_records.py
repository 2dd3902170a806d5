"""Records of a comparison, as run files hold them."""

from pathlib import Path

from example_records import JUDGED

from mjbench.commands.show.kinds import RECORD_TYPES
from mjbench.host import machine
from mjbench.results import run_writer, runs
from mjbench.simulation.accelerated_judgement import Precision
from mjbench.status import Status
from mjbench.verification.records import VariantRecord

RECORD = VariantRecord(
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
    assert run.of_type(VariantRecord) == [RECORD]
