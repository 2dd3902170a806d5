"""The committed runs are readable, whole, and say what the documentation says of them."""

from pathlib import Path

import pytest

from mjbench import models, runs, selfcheck, stats
from mjbench.report import results

RUNS = Path(__file__).parent.parent / "results/runs"
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


def test_the_committed_selfchecks_hold_what_is_claimed_of_verdicts() -> None:
    """At most 1 % false alarms, never a wrong direction, power of 95 % at 1 % and 99 % at 2 %."""
    if not CHECKED:
        pytest.skip("no selfcheck is committed")
    records = [record for file in CHECKED for record in runs.load(file)[1:]]
    rows = selfcheck.summary(records)
    same = [row for row in rows if row["slowdown"] == 0]
    trials = sum(row["trials"] for row in same)
    assert trials >= 300  # with no alarm among them, 1 % is excluded at 95 %
    assert sum(row["trials"] * row["wrong"] for row in same) == 0
    for row in rows:
        power = {0.01: 0.95, 0.02: 0.99}.get(row["slowdown"], 0.0)
        assert row["wrong"] == 0
        assert row["detected"] >= power
        assert abs(row["error"]) < 0.001
