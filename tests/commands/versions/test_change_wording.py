"""The ratio of two targets in the words of its metric."""

import pytest

from mjbench.commands.versions.change_wording import describe_ratio
from mjbench.interval import Interval
from mjbench.paired.metrics import Metric
from mjbench.paired.outcomes import Verdict


@pytest.mark.parametrize(
    ("metric", "verdict", "ratio", "text"),
    [
        (Metric.LOAD, Verdict.SLOWER, Interval(1.05, 1.04, 1.06), "slower by 5 % (interval "),
        (Metric.LOAD, Verdict.SLOWER, Interval(3.0, 2.9, 3.1), "slower, takes 3 times as long"),
        (
            Metric.MEMORY,
            Verdict.SLOWER,
            Interval(1.05, 1.04, 1.06),
            "more memory by 5 % (interval ",
        ),
        (Metric.MEMORY, Verdict.SLOWER, Interval(3.0, 2.9, 3.1), "more memory by 200 %"),
        (Metric.MEMORY, Verdict.INCONCLUSIVE, Interval(1.0, None, None), "inconclusive, "),
    ],
)
def test_a_change_is_said_in_the_words_of_its_metric(
    metric: Metric, verdict: Verdict, ratio: Interval, text: str
) -> None:
    assert describe_ratio(metric, verdict, ratio).startswith(text)
