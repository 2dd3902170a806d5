"""The table of `benchmarks/studies/speed_checks.py`, of measurements that the test invents."""

from benchmarks.studies import speed_checks
from benchmarks.studies.speed_checks import FUNCTIONS, Measured
from mjbench.testing.callables import Answer


def measured(log_ratio: float, slowness: float, answer: Answer) -> list[Measured]:
    """Return what a process measured of each function, on a machine of some slowness."""
    return [Measured(name, "quiet", answer, log_ratio, 1e-3 * slowness) for name in FUNCTIONS]


def test_the_table_counts_answers_and_says_how_far_ratios_and_times_spread() -> None:
    rows = [
        *measured(-0.01, 1.0, Answer.NOT_SLOWER),
        *measured(0.01, 1.0, Answer.INCONCLUSIVE),
        *measured(0.01, 4.0, Answer.SLOWER),
    ]
    line = speed_checks.table(rows)[2]
    assert line == "| 20 steps of the cart-pole | 3 | 0.9 % | 1.0 % | 1 | 1 | 1 | 65.4 % |"
