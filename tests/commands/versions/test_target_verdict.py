"""The verdict on two targets, by the instructions of the engine."""

import pytest
from example_counts import counted, followed_counts

from mjbench.commands.versions.target_verdict import instruction_verdict
from mjbench.counts.instructions import ModelCount
from mjbench.paired.metrics import Metric
from mjbench.paired.outcomes import Verdict
from mjbench.status import Status


@pytest.mark.parametrize(
    ("candidate", "expected"),
    [
        (1004.0, Verdict.SAME),
        (1005.0, Verdict.SLOWER),
        (1100.0, Verdict.SLOWER),
        (900.0, Verdict.FASTER),
    ],
)
def test_a_verdict_on_instructions_is_exact(candidate: float, expected: Verdict) -> None:
    row = instruction_verdict(counted("1.0", a=1000.0), counted("2.0", a=candidate), 0.005)
    assert row.metric is Metric.INSTRUCTIONS
    assert row.verdict is expected
    assert row.ratio.low < candidate / 1000 < row.ratio.high
    assert row.changed_work is False


def test_a_step_that_leads_elsewhere_is_changed_work() -> None:
    baseline, here, elsewhere = followed_counts()
    assert not instruction_verdict(baseline, here, 0.005).changed_work
    assert instruction_verdict(baseline, elsewhere, 0.005).changed_work


def test_a_model_that_could_not_be_counted_has_no_verdict() -> None:
    crashed = ModelCount(
        model="m", release="2.0", status=Status.CRASHED, detail="killed by signal 11"
    )
    row = instruction_verdict(counted("1.0", a=1000.0), crashed, 0.005)
    assert (row.status, row.verdict, row.ratio, row.work) == (Status.CRASHED, None, None, None)
    assert row.detail == "MuJoCo 2.0: killed by signal 11"
