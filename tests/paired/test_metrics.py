"""What a paired comparison can compare: one declaration for each metric."""

import pytest

from mjbench.errors import InputError
from mjbench.paired import operations, targets
from mjbench.paired.metrics import METRICS, Measured
from mjbench.paired.outcomes import Metric, Verdict


def test_every_metric_is_declared_once_and_says_what_it_means() -> None:
    assert list(METRICS) == list(Metric)
    meanings = [spec.meaning for spec in METRICS.values()]
    assert all(meanings)
    assert len(set(meanings)) == len(meanings)


def test_only_the_usual_metric_is_of_all_paths_and_has_no_name_of_its_own() -> None:
    usual = METRICS[Metric.TIME]
    assert not usual.refusal
    assert not usual.suffix
    others = [spec for spec in METRICS.values() if spec != usual]
    assert all(spec.refusal and spec.suffix for spec in others)


@pytest.mark.parametrize("metric", [m for m in Metric if m != Metric.TIME])
def test_a_metric_of_the_plain_loop_refuses_other_paths(metric: Metric) -> None:
    targets.check_metric(metric, ["python_loop", "python_loop"])
    with pytest.raises(InputError, match=rf"--metric {metric} .*: leave out --paths"):
        targets.check_metric(metric, ["python_loop", "rollout"])


def test_operations_that_are_compared_can_be_done_on_any_model() -> None:
    compared = [m for m, spec in METRICS.items() if spec.measured == Measured.OPERATION]
    for metric in compared:
        operation = operations.find(metric.value, repeats=3)
        assert (operation.name, operation.model, operation.repeats) == (metric.value, "", 3)


def test_a_verdict_is_said_in_the_words_of_its_metric() -> None:
    assert METRICS[Metric.LOAD].outcome(Verdict.SLOWER) == "slower"
    assert METRICS[Metric.MEMORY].outcome(Verdict.SLOWER) == "more memory"
    assert METRICS[Metric.GROWTH].outcome(Verdict.FASTER) == "less growth"
    assert METRICS[Metric.MEMORY].outcome(Verdict.SAME) == "same"
