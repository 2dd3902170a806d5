"""The committed runs are readable and complete, and say what the documentation says of them."""

from pathlib import Path

import pytest
from commands import ROOT

from mjbench.instrument import runs
from mjbench.paired import selfcheck
from mjbench.paired.records import TrialRecord
from mjbench.paired.verdict import judge
from mjbench.report.advice import advise
from mjbench.report.documents import RECORD_TYPES
from mjbench.report.results import derive_all

RUNS = ROOT / "results/runs"
COMPARISONS = sorted(RUNS.glob("reference-mujoco-*.jsonl"))
SELFCHECKS = sorted(RUNS.glob("reference-selfcheck-*.jsonl"))


def test_every_committed_run_is_tested_and_there_is_one_of_each_kind() -> None:
    assert COMPARISONS
    assert SELFCHECKS
    assert {*COMPARISONS, *SELFCHECKS} == set(RUNS.glob("reference-*.jsonl"))


@pytest.mark.parametrize("file", COMPARISONS, ids=lambda f: f.stem)
def test_the_committed_comparison_is_complete_and_every_path_agreed(file: Path) -> None:
    """Complete: every path on every model that its header names."""
    run = runs.load(file, RECORD_TYPES)
    groups = derive_all(run.records)
    assert [group.model.model for group in groups] == run.header.arguments["models"]
    assert groups
    for group in groups:
        variants = [[result.path, result.options] for result in group.results]
        assert variants == run.header.arguments["variants"], group.model.model
        assert all(result.agrees and result.step_ns for result in group.results)
        assert {advice.loop.value for advice in advise(group.results)} == {"open", "closed"}


@pytest.mark.parametrize("file", SELFCHECKS, ids=lambda f: f.stem)
def test_verdicts_of_the_committed_selfchecks_follow_from_their_launches(file: Path) -> None:
    run = runs.load(file, RECORD_TYPES)
    limits = [run.header.arguments[name] for name in ("min_effect", "confidence", "precision")]
    trials = run.of_type(TrialRecord)
    assert trials
    for trial in trials:
        judgement = judge(trial.launches, *limits)
        assert judgement.verdict == trial.verdict
        assert judgement.ratio == pytest.approx(trial.estimate, abs=1e-6)


@pytest.mark.parametrize("file", SELFCHECKS, ids=lambda f: f.stem)
def test_no_verdict_of_the_committed_selfchecks_is_wrong(file: Path) -> None:
    """No false alarm, never a wrong direction, and every slowdown of 1 % and 2 % detected."""
    rows = selfcheck.summary(runs.load(file, RECORD_TYPES).of_type(TrialRecord))
    assert {row.model for row in rows} == {"cartpole", "humanoid"}
    assert {row.slowdown for row in rows} >= {0.0, 0.01, 0.02}
    for row in rows:
        assert row.wrong == 0
        if row.slowdown >= 0.01:
            assert row.detected == 1
