"""What run files hold of searches: those of earlier versions load as those of today."""

import math
from pathlib import Path

import pytest
from tuning_values import ENGINE_TUNE, FEWER, stored

from mjbench.errors import InputError
from mjbench.report.kinds import RECORD_TYPES
from mjbench.status import Status
from mjbench.store import runs
from mjbench.tuning.records import TuneRecord
from mjbench.tuning.settings import Edit, Part, label


def read(file: Path) -> TuneRecord:
    """Return the only record of a run file."""
    (record,) = runs.load(file, RECORD_TYPES).of_type(TuneRecord)
    return record


def test_a_search_of_warp_that_an_earlier_version_stored_has_what_those_of_today_have(
    tmp_path: Path,
) -> None:
    record = read(stored(tmp_path, ENGINE_TUNE))
    assert record.engine == "warp" and record.present is None
    assert record.batch is not None and record.batch.nbatch == 64
    assert record.batch.facts is not None and record.batch.facts.horizon_ncontrol == 31
    assert record.batch.present is not None and record.batch.present.compile_s == 12.0
    tried, failed = record.attempts
    assert tried.time_ratio is not None and math.isclose(tried.time_ratio, 0.8)
    assert tried.error is not None and tried.error.share == 1e-4
    assert failed.status == Status.FAILED and failed.time_ratio is failed.error is None
    best = record.best()
    assert best is not None and label(best.settings) == "iterations=4"
    assert best.settings[0].edits == (Edit(Part.OPTION, "iterations", "4"),)
    assert record.withdrawn[0].reason == "not certainly faster"


def test_a_search_of_c_that_an_earlier_version_stored_is_of_c(tmp_path: Path) -> None:
    attempt = {"settings": [FEWER], "status": "ok", "accuracy": None, "time_ratio": 0.9}
    record = read(stored(tmp_path, {"type": "tune", "model": "robot", "attempts": [attempt]}))
    assert record.engine == "c" and record.batch is None
    assert record.attempts[0].time_ratio == 0.9


@pytest.mark.parametrize("broken", [{"attempts": 3}, {"nbatch": 0}, {"facts": 1}])
def test_a_broken_search_is_one_line(tmp_path: Path, broken: dict[str, object]) -> None:
    file = stored(tmp_path, {**ENGINE_TUNE, **broken})
    with pytest.raises(InputError, match="line 2"):
        read(file)
