"""How far two measurements of the same releases differ."""

import math

import pytest
from speed_histories import VERSIONS, record

from benchmarks.history.speed_history import from_records
from benchmarks.studies.history_repeats import repeated


def test_only_releases_that_both_have_are_compared() -> None:
    first = from_records([record(v, 1.0) for v in VERSIONS[:4]])
    second = from_records(
        [record(v, 1.02) for v in VERSIONS[2:6]] + [record("1.2", 1.0, model="cloth")]
    )
    pile, cloth = repeated(first, second)
    assert pile == pytest.approx([math.log(1.02)] * 2)
    assert len(cloth) == 0
