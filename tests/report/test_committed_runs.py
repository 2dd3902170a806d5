"""The committed runs are readable, whole, and say what the documentation says of them."""

from pathlib import Path

import pytest
from commands import ROOT

from mjbench.instrument import runs, stats
from mjbench.paired import selfcheck
from mjbench.report import results
from mjbench.simulation import models

RUNS = ROOT / "results/runs"
COMPARED = sorted(RUNS.glob("reference-mujoco-*.jsonl"))
CHECKED = sorted(RUNS.glob("reference-selfcheck-*.jsonl"))


@pytest.mark.parametrize("file", COMPARED, ids=lambda f: f.stem)
def test_the_committed_run_is_whole_and_every_path_agreed(file: Path) -> None:
    _, *records = runs.load(file)
    groups = results.by_model(records)
    assert [group[0]["model"] for group in groups] == models.shipped()
    for group in groups:
        found = results.of_model(group)
        assert all(r["agrees"] and r["step_ns"] for r in found), group[0]["model"]
        assert {a["loop"] for a in results.advice(found)} == {"open", "closed"}


@pytest.mark.parametrize("file", CHECKED, ids=lambda f: f.stem)
def test_verdicts_of_the_committed_selfchecks_follow_from_their_launches(file: Path) -> None:
    head, *records = runs.load(file)
    asked = head["arguments"]
    limits = [asked[key] for key in ("min_effect", "confidence", "precision")]
    for record in records:
        judged = stats.judge(record["launches"], *limits)
        assert judged.verdict == record["verdict"]
        assert judged.ratio == pytest.approx(record["estimate"], abs=1e-6)


@pytest.mark.parametrize("file", CHECKED, ids=lambda f: f.stem)
def test_no_verdict_of_the_committed_selfchecks_is_wrong(file: Path) -> None:
    """No false alarm, never a wrong direction, and every slowdown of 1 % and 2 % found."""
    rows = selfcheck.summary(runs.load(file)[1:])
    assert {row["model"] for row in rows} == {"cartpole", "humanoid"}
    assert {row["slowdown"] for row in rows} >= {0.0, 0.01, 0.02}
    for row in rows:
        assert row["wrong"] == 0
        if row["slowdown"] >= 0.01:
            assert row["detected"] == 1
