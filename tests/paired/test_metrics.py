"""What a paired comparison can compare: one declaration for each metric."""

import pytest

from mjbench.errors import InputError
from mjbench.paired import targets
from mjbench.paired.metrics import METRICS, Metric
from mjbench.paired.outcomes import Verdict


@pytest.mark.parametrize("metric", [m for m, s in METRICS.items() if not s.of_compiling_paths])
def test_a_metric_of_the_plain_loop_refuses_other_paths(metric: Metric) -> None:
    targets.check_metric(metric, ["python_loop", "python_loop"])
    with pytest.raises(InputError, match=rf"--metric {metric} .*: leave out rollout"):
        targets.check_metric(metric, ["python_loop", "rollout"])


def test_paths_that_do_not_compile_have_no_time_of_compiling() -> None:
    for paths in (["python_loop"], ["rollout", "python_loop"]):
        with pytest.raises(InputError, match="--metric compile is of paths that compile only"):
            targets.check_metric(Metric.COMPILE, paths)


@pytest.mark.parametrize(
    ("metric", "settings", "message"),
    [
        (Metric.LOAD, "solver=cg,iterations=5", "without solver and iterations: leave out solver"),
        (Metric.INSTRUCTIONS, "solver=cg", "the instructions of the engine without solver: leave"),
        (Metric.RAYS, "timer=off", "--metric rays compares casting rays without timer: leave out"),
        (Metric.MEMORY, "timer=off", "without timer: leave out timer"),
    ],
)
def test_a_setting_that_a_metric_does_not_see_is_refused(
    metric: Metric, settings: str, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        targets.check_targets(metric, targets.parse("pile", settings))


def test_other_settings_are_compared_by_any_metric() -> None:
    targets.check_targets(Metric.TIME, targets.parse("pile,timer=off", "solver=cg"))
    for metric in (Metric.MEMORY, Metric.RESET):
        targets.check_targets(metric, targets.parse("pile", "solver=cg"))
    targets.check_targets(Metric.TIME, targets.parse("pile", "clock=off"))


def test_a_verdict_is_said_in_the_words_of_its_metric() -> None:
    assert METRICS[Metric.LOAD].outcome(Verdict.SLOWER) == "slower"
    assert METRICS[Metric.MEMORY].outcome(Verdict.SLOWER) == "more memory"
    assert METRICS[Metric.MEMORY].outcome(Verdict.FASTER) == "less memory"
    assert METRICS[Metric.MEMORY].outcome(Verdict.SAME) == "same"
