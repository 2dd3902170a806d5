"""Records of a comparison, as run files hold them."""

import json
from dataclasses import asdict
from pathlib import Path

from example_records import CHECK

from mjbench.comparison.records import RECORD_TYPES, MeasurementRecord
from mjbench.host import machine
from mjbench.simulation.accelerated_limits import Precision
from mjbench.status import Status
from mjbench.store import run_file, runs

RECORD = MeasurementRecord(
    model="m",
    path="mjx",
    options={},
    status=Status.OK,
    precision=Precision.FLOAT32,
    check=CHECK,
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


def test_a_check_with_the_keys_of_earlier_versions_is_read(tmp_path: Path) -> None:
    path = stored(tmp_path)
    header, line = path.read_text().splitlines()
    record = json.loads(line)
    earlier = {
        "unconstrained_steps": "free_steps",
        "unconstrained_error": "free_stray",
        "constrained_error": "constrained_stray",
        "contact_error": "contact_stray",
        "unconstrained_nstep": "free_nstep",
        "unconstrained_difference": "free_difference",
        "unconstrained_shadow": "free_shadow",
    }
    assert set(earlier) <= set(asdict(CHECK))
    record["check"] = {earlier.get(name, name): v for name, v in record["check"].items()}
    path.write_text(f"{header}\n{json.dumps(record)}\n")
    assert runs.load(path, RECORD_TYPES).of_type(MeasurementRecord) == [RECORD]
