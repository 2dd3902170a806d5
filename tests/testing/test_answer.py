"""What an interval says, and how the answer reads."""

import math

import pytest

from mjbench.testing import answer
from mjbench.testing.answer import Answer, SpeedCheck


@pytest.mark.parametrize(
    ("low", "high", "expected"),
    [
        (-0.5, -0.1, Answer.NOT_SLOWER),
        (-0.01, math.log1p(0.05), Answer.NOT_SLOWER),
        (0.01, 0.06, Answer.INCONCLUSIVE),
        (-math.inf, math.inf, Answer.INCONCLUSIVE),
        (math.log1p(0.05), 0.06, Answer.INCONCLUSIVE),
        (0.05, 0.06, Answer.SLOWER),
    ],
)
def test_only_an_interval_on_one_side_of_the_limit_decides(
    low: float, high: float, expected: Answer
) -> None:
    assert answer.of_interval(low, high, max_slowdown=0.05) == expected


def test_an_answer_is_a_line_with_its_figures() -> None:
    check = SpeedCheck(Answer.SLOWER, 0.05, 0.99, 1.12, 1.10, 1.14, 2.5e-5, 2.2e-5, 9)
    assert str(check) == (
        "slower: +12.0 % (interval +10.0 to +14.0 %, 5 % allowed), 25 µs a call, baseline 22 µs"
    )


def test_without_figures_the_reason_stands_alone() -> None:
    check = SpeedCheck(Answer.INCONCLUSIVE, 0.05, 0.99, detail="benchmarks are disabled")
    assert str(check) == "inconclusive: benchmarks are disabled"
