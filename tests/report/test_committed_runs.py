"""The committed runs are readable and complete, and say what the documentation says of them."""

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
from commands import ROOT
from committed_trials import BETWEEN_BUILDS, INSIDE_STEP, RUNS, SELFCHECKS, trials_of

from benchmarks.studies import selfcheck_page
from benchmarks.studies.page_part import of_lines
from mjbench.paired import selfcheck
from mjbench.paired.outcomes import Verdict
from mjbench.paired.race_record import Loop
from mjbench.paired.selfcheck_records import TrialRecord
from mjbench.paired.verdict import judge
from mjbench.paths import BASE
from mjbench.releases.release import NO_CHANGE_PAIRS
from mjbench.report.advice import advise
from mjbench.report.kinds import RECORD_TYPES
from mjbench.report.path_speedups import derive_all
from mjbench.simulation import models
from mjbench.simulation.accelerated_judgement import EngineAnswer
from mjbench.status import Status
from mjbench.store import runs

COMPARISONS = sorted(RUNS.glob("reference-mujoco-*.jsonl"))
STORY = sorted(RUNS.glob("reference-story-*.jsonl"))
CHECKUP = RUNS / "reference-checkup-humanoid.jsonl"
MJX = RUNS / "reference-mjx-cpu.jsonl"
GPU = sorted(RUNS.glob("reference-gpu-*.jsonl"))


def test_every_committed_run_is_tested_and_there_is_one_of_each_kind() -> None:
    assert COMPARISONS
    assert SELFCHECKS
    assert INSIDE_STEP
    assert len(BETWEEN_BUILDS) == 6
    series = {*COMPARISONS, *SELFCHECKS, *INSIDE_STEP, *BETWEEN_BUILDS, *STORY, *GPU}
    committed = series | {CHECKUP, MJX}
    assert committed == set(RUNS.glob("reference-*.jsonl"))


@pytest.mark.parametrize("file", sorted((ROOT / "results").glob("*/reference-*.jsonl")))
def test_no_committed_run_names_a_folder_of_the_machine_that_wrote_it(file: Path) -> None:
    header = json.loads(file.read_text().splitlines()[0])
    texts = [*header["command_line"], json.dumps(header["arguments"])]
    assert not any(re.search(r"(^|[\s\"=])/\w", text) for text in texts)


@pytest.mark.parametrize("file", COMPARISONS, ids=lambda f: f.stem)
def test_the_committed_comparison_is_complete_and_every_path_agreed(file: Path) -> None:
    """Complete: every path on every model that its header names."""
    run = runs.load(file, RECORD_TYPES)
    groups = derive_all(run.records)
    assert [group.model.model for group in groups] == run.header.arguments["models"]
    assert groups
    for group in groups:
        variants = [{"path": r.path, "options": r.options} for r in group.results]
        assert variants == run.header.arguments["variants"], group.model.model
        compared = [r for r in group.results if r.status != Status.UNAVAILABLE]
        assert {r.path for r in group.results if r not in compared} <= {"mjx", "mjx64"}
        assert all(result.agrees and result.step_ns for result in compared)
        advice = advise(group)
        assert {row.loop for row in advice} == set(Loop)
        assert all(row.speedup and row.speedup.is_above(1) for row in advice if row.path != BASE)


@pytest.mark.parametrize("file", GPU, ids=lambda f: f.stem)
def test_what_a_gpu_computed_agrees_and_is_timed_also_where_c_was_not(file: Path) -> None:
    groups = derive_all(runs.load(file, RECORD_TYPES).records)
    compiled = [r for group in groups for r in group.results if r.compile_s is not None]
    answers = {r.judgement.answer for r in compiled if r.judgement is not None}
    (device,) = {r.device for r in compiled}
    assert device in ("NVIDIA H200", "NVIDIA H100 80GB HBM3")
    assert answers == {EngineAnswer.YES}
    assert all(result.step_ns and result.steps_per_s for result in compiled)
    beside_c = [group.base is not None and group.base.is_timed for group in groups]
    assert [r.speedup is not None for r in compiled] == [
        timed
        for group, timed in zip(groups, beside_c, strict=True)
        for r in group.results
        if r.compile_s is not None
    ]


@pytest.mark.parametrize("file", SELFCHECKS, ids=lambda f: f.stem)
def test_launches_of_the_committed_selfchecks_lead_to_no_wrong_verdict(file: Path) -> None:
    """Those as shipped ended by an earlier rule, and may be too few for today's."""
    run = runs.load(file, RECORD_TYPES)
    limits = [run.header.arguments[name] for name in ("min_effect", "confidence", "precision")]
    trials = run.of_type(TrialRecord)
    assert trials
    for trial in trials:
        judgement = judge(trial.launches, *limits, trial.residues or None)
        if trial.averaged:
            assert judgement.verdict == trial.verdict
        right = {0.0: Verdict.SAME, 0.01: Verdict.SLOWER, 0.02: Verdict.SLOWER}
        if trial.slowdown in right:
            assert judgement.verdict in (right[trial.slowdown], Verdict.INCONCLUSIVE)
        assert judgement.verdict != Verdict.FASTER
        assert judgement.ratio.estimate == pytest.approx(trial.estimate, abs=0.005)


def test_launches_of_the_committed_selfchecks_are_not_correlated() -> None:
    """Each with the one before; residuals of n launches have a correlation of -1 / n by chance."""
    products, variances = 0.0, 0.0
    for file in SELFCHECKS:
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


@pytest.mark.parametrize("file", SELFCHECKS, ids=lambda f: f.stem)
def test_no_verdict_of_the_committed_selfchecks_is_wrong(file: Path) -> None:
    """No false alarm, never a wrong direction, and every slowdown of 1 % and 2 % detected."""
    rows = selfcheck.summary(runs.load(file, RECORD_TYPES).of_type(TrialRecord))
    assert {row.model for row in rows} == {"cartpole", "humanoid"}
    assert {row.slowdown for row in rows} >= {0.0, 0.01}
    for row in rows:
        assert row.wrong == 0
        if row.slowdown >= 0.01:
            assert row.detected == 1
        if row.averaged:
            assert row.trials >= 50
            assert abs(row.error) <= 0.001


@pytest.mark.parametrize("file", INSIDE_STEP, ids=lambda f: f.stem)
def test_slowdowns_inside_a_step_of_at_least_the_smallest_effect_are_found(file: Path) -> None:
    run = runs.load(file, RECORD_TYPES)
    trials = run.of_type(TrialRecord)
    for row in selfcheck.summary(trials):
        case = row.model, row.callback
        estimates = [t.estimate for t in trials if (t.model, t.callback) == case]
        assert row.wrong == 0
        if np.mean(estimates) - 1 >= run.header.arguments["min_effect"]:
            assert row.detected == 1


@pytest.mark.parametrize("file", BETWEEN_BUILDS, ids=lambda f: f.stem)
def test_at_most_one_of_forty_no_change_pairs_is_called_different_by_code(file: Path) -> None:
    trials = runs.load(file, RECORD_TYPES).of_type(TrialRecord)
    pairs = {(trial.model, trial.old, trial.new) for trial in trials}
    assert len(pairs) == len(NO_CHANGE_PAIRS) * len(models.shipped())
    different = [trial for trial in trials if trial.verdict in (Verdict.SLOWER, Verdict.FASTER)]
    assert len(different) <= len(trials) / 40
    assert all(trial.placement is not None and trial.placement.averaged for trial in trials)


def test_the_page_of_errors_has_the_verdicts_of_all_committed_selfchecks() -> None:
    trials = selfcheck_page.committed_trials()
    assert len(trials) == len(trials_of([*SELFCHECKS, *INSIDE_STEP, *BETWEEN_BUILDS]))
    assert selfcheck_page.PART.text() == of_lines(selfcheck_page.lines(trials))


def test_no_false_alarm_excludes_the_rate_that_the_page_names() -> None:
    alike = sum(trial.slowdown == 0 for trial in trials_of(SELFCHECKS))
    excluded = 100 * (1 - 0.05 ** (1 / alike))
    page = (ROOT / "docs/method/errors.md").read_text()
    assert (
        f"No false alarm in {alike} excludes a rate above {math.ceil(10 * excluded) / 10} %" in page
    )


def test_the_story_has_the_commands_of_its_runs() -> None:
    page = (ROOT / "docs/guides/story.md").read_text()
    for file in STORY:
        words = runs.load(file, RECORD_TYPES).header.command_line
        assert any(" ".join(words[:2]) in line for line in page.splitlines()), words
