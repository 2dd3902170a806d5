"""What the committed trials of verdicts say, and docs/method/errors.md with them."""

import math
from pathlib import Path

import numpy as np
import pytest
from commands import ROOT
from committed_trials import BETWEEN_BUILDS, INSIDE_STEP, KNOWN, TRIALS, trials_of

from benchmarks.history.speed_series import NO_CHANGE_PAIRS
from benchmarks.studies.page_part import of_lines
from benchmarks.verdicts import page, trials
from benchmarks.verdicts.records import RECORD_TYPES, TrialRecord
from mjbench.paired.outcomes import Verdict
from mjbench.paired.verdict import VerdictPlan, judge
from mjbench.results import runs
from mjbench.simulation import models


def test_every_committed_run_is_tested() -> None:
    assert {*KNOWN, *INSIDE_STEP, *BETWEEN_BUILDS} == {*TRIALS.glob("*.jsonl")}
    assert len(BETWEEN_BUILDS) == 5


@pytest.mark.parametrize("file", KNOWN, ids=lambda f: f.stem)
def test_launches_of_the_committed_trials_lead_to_no_wrong_verdict(file: Path) -> None:
    run = runs.load(file, RECORD_TYPES)
    names = "min_effect", "confidence", "precision"
    plan = VerdictPlan(*(run.header.arguments[name] for name in names))
    stored = run.of_type(TrialRecord)
    assert stored
    for trial in stored:
        judgement = judge(trial.launches, plan, trial.residues or None)
        assert judgement.verdict == trial.verdict
        right = {0.0: Verdict.SAME, 0.01: Verdict.SLOWER}
        assert judgement.verdict in (right[trial.slowdown], Verdict.INCONCLUSIVE)
        assert judgement.ratio.estimate == pytest.approx(trial.estimate, abs=0.005)


def test_launches_of_the_committed_trials_are_not_correlated() -> None:
    """Each with the one before; residuals of n launches have a correlation of -1 / n by chance."""
    products, variances = 0.0, 0.0
    for file in KNOWN:
        for trial in runs.load(file, RECORD_TYPES).of_type(TrialRecord):
            x = np.array(trial.launches)
            distances = x - np.median(x)
            deviation = 1.4826 * np.median(np.abs(distances))
            clipped = np.clip(distances / deviation, -2.5, 2.5)
            clipped -= clipped.mean()
            variance = clipped.var(ddof=1)
            products += (clipped[1:] * clipped[:-1]).sum() + variance * (len(x) - 1) / len(x)
            variances += variance * (len(x) - 1)
    assert abs(products / variances) < 0.02


@pytest.mark.parametrize("file", KNOWN, ids=lambda f: f.stem)
def test_no_verdict_of_the_committed_trials_is_wrong(file: Path) -> None:
    """No false alarm, never a wrong direction, and every slowdown of 1 % detected."""
    rows = trials.summary(runs.load(file, RECORD_TYPES).of_type(TrialRecord))
    assert {row.model for row in rows} == {"cartpole", "humanoid"}
    assert {row.slowdown for row in rows} >= {0.0, 0.01}
    for row in rows:
        assert row.wrong == 0
        if row.slowdown >= 0.01:
            assert row.detected == 1
        assert row.trials >= 50
        assert abs(row.error) <= 0.001


@pytest.mark.parametrize("file", INSIDE_STEP, ids=lambda f: f.stem)
def test_slowdowns_inside_a_step_of_at_least_the_smallest_effect_are_found(file: Path) -> None:
    run = runs.load(file, RECORD_TYPES)
    stored = run.of_type(TrialRecord)
    for row in trials.summary(stored):
        case = row.model, row.callback
        estimates = [t.estimate for t in stored if (t.model, t.callback) == case]
        assert row.wrong == 0
        if np.mean(estimates) - 1 >= run.header.arguments["min_effect"]:
            assert row.detected == 1


@pytest.mark.parametrize("file", BETWEEN_BUILDS, ids=lambda f: f.stem)
def test_at_most_one_of_forty_no_change_pairs_is_called_different_by_code(file: Path) -> None:
    stored = runs.load(file, RECORD_TYPES).of_type(TrialRecord)
    pairs = {(trial.model, trial.old, trial.new) for trial in stored}
    assert len(pairs) == len(NO_CHANGE_PAIRS) * len(models.shipped())
    different = [trial for trial in stored if trial.verdict in (Verdict.SLOWER, Verdict.FASTER)]
    assert len(different) <= len(stored) / 40
    assert all(trial.placement is not None and trial.placement.averaged for trial in stored)


def test_the_page_of_errors_has_the_verdicts_of_all_committed_trials() -> None:
    stored = page.committed_trials()
    assert len(stored) == len(trials_of([*KNOWN, *INSIDE_STEP, *BETWEEN_BUILDS]))
    assert page.PART.text() == of_lines(page.lines(stored))


def test_no_false_alarm_excludes_the_rate_that_the_page_names() -> None:
    alike = sum(trial.slowdown == 0 for trial in trials_of(KNOWN))
    excluded = 100 * (1 - 0.05 ** (1 / alike))
    text = (ROOT / "docs/method/errors.md").read_text()
    assert (
        f"No false alarm in {alike} excludes a rate above {math.ceil(10 * excluded) / 10} %" in text
    )
