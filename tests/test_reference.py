"""The committed run is readable, whole, and of the models that are shipped."""

from pathlib import Path

import pytest

from mjbench import models, runs
from mjbench.report import results

FILES = sorted((Path(__file__).parent.parent / "results/runs").glob("reference-*.jsonl"))


@pytest.mark.parametrize("file", FILES, ids=lambda f: f.stem)
def test_the_committed_run_is_whole_and_every_path_agreed(file: Path) -> None:
    _, *records = runs.load(file)
    groups = results.by_model(records)
    assert [group[0]["model"] for group in groups] == models.shipped()
    for group in groups:
        found = results.of_model(group)
        assert all(r["agrees"] and r["step_ns"] for r in found), group[0]["model"]
        assert {a["loop"] for a in results.advice(found)} == {"open", "closed"}
