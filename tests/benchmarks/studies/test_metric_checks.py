"""What the check of metrics plants, and what it calls wrong."""

from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest
from commands import ROOT
from verdict_records import SLOWER

from benchmarks.studies import tally_file
from benchmarks.studies.metric_checks import (
    PAIRED,
    Case,
    Result,
    baseline,
    is_wrong,
    planted,
    unchanged,
)
from mjbench.paired.metrics import Metric
from mjbench.paired.outcomes import Verdict
from mjbench.paired.targets import Target
from mjbench.simulation import models
from mjbench.simulation.model_digest import model_digest
from mjbench.status import Status


def test_each_fault_is_of_some_metrics_and_all_others_look_for_it(tmp_path: Path) -> None:
    cases = list(planted(tmp_path, PAIRED))
    files_read = {*PAIRED} - {Metric.COMPILE}
    assert {case.metric for case in cases if case.name == "a longer file"} == files_read
    traced = {case.metric for case in cases if case.name == "slower tracing"}
    assert traced == {Metric.COMPILE, Metric.TIME}
    finders = {(case.name, case.metric) for case in cases if case.is_slower}
    assert finders == {
        ("a longer file", Metric.LOAD),
        ("a heavier step", Metric.TIME),
        ("slower tracing", Metric.COMPILE),
    }


def test_a_longer_file_holds_the_same_model(tmp_path: Path) -> None:
    case = next(planted(tmp_path, PAIRED))
    assert isinstance(case.candidate, Target)
    assert case.candidate.model.path.stat().st_size > 100_000
    digests = {model_digest(models.load(each.model)) for each in (baseline(), case.candidate)}
    assert len(digests) == 1


def test_unchanged_models_are_compared_as_often_as_asked_for_by_each_metric() -> None:
    cases = list(unchanged([Metric.LOAD, Metric.MEMORY], 3))
    assert [case.metric for case in cases] == [Metric.LOAD] * 3 + [Metric.MEMORY] * 3
    assert not any(case.is_slower for case in cases)


@pytest.mark.parametrize(
    ("is_slower", "verdict", "status", "wrong"),
    [
        (True, Verdict.SLOWER, Status.OK, False),
        (True, Verdict.SAME, Status.OK, True),
        (True, Verdict.INCONCLUSIVE, Status.OK, True),
        (False, Verdict.SAME, Status.OK, False),
        (False, Verdict.INCONCLUSIVE, Status.OK, False),
        (False, Verdict.SLOWER, Status.OK, True),
        (False, None, Status.CRASHED, True),
    ],
)
def test_what_was_missed_falsely_named_or_not_measured_is_wrong(
    is_slower: bool, verdict: Verdict | None, status: Status, wrong: bool
) -> None:
    case = Case("any", Metric.LOAD, Metric.LOAD, baseline(), is_slower)
    assert is_wrong(case, replace(SLOWER, verdict=verdict, status=status)) == wrong


def test_committed_comparisons_are_right_and_as_many_as_the_page_has() -> None:
    results = tally_file.load(ROOT / "results/metrics.json", list[Result], "metrics")
    measured = {result.checks for result in results}
    assert measured == {*PAIRED}
    undecided = Counter[str]()
    for metric in measured:
        of_metric = [result for result in results if result.checks == metric]
        itself = [r.verdict.verdict for r in of_metric if r.case.startswith("itself")]
        assert len(itself) == 20
        assert set(itself) <= {Verdict.SAME, Verdict.INCONCLUSIVE}
        undecided[metric] = itself.count(Verdict.INCONCLUSIVE)
        for result in of_metric:
            if not result.case.startswith("itself"):
                right = Verdict.SLOWER if result.is_slower else Verdict.SAME
                if metric == Metric.COMPILE and not result.is_slower:  # the time of MJX's steps
                    right = Verdict.INCONCLUSIVE
                assert result.verdict.verdict == right
    assert +undecided == {"compile": 20, "load": 14, "rollout": 1}
