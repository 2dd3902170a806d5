"""The tables of `benchmarks/speed_checks.py`, of measurements that the test invents."""

import numpy as np

from benchmarks import speed_checks
from benchmarks.speed_checks import FUNCTIONS, Measured
from mjbench.instrument import machine
from mjbench.testing import calibrator
from mjbench.testing.answer import Answer
from mjbench.testing.stored import Occasion


def measured(log_ratio: float, slowness: float, answer: Answer) -> list[Measured]:
    """Return what a process measured of each function, on a machine of some slowness."""
    logs = (np.log(slowness) + 0.001 * np.linspace(-1, 1, 8)).tolist()
    occasion = Occasion(calibrator.VERSION, machine.cpu_name(), [0.0, 0.001], logs)
    return [
        Measured(name, "quiet", answer, log_ratio, 1e-3 * slowness, occasion) for name in FUNCTIONS
    ]


def test_the_tables_count_answers_and_say_how_far_ratios_spread() -> None:
    rows = [
        *measured(-0.01, 1.0, Answer.NOT_SLOWER),
        *measured(0.01, 1.0, Answer.INCONCLUSIVE),
        *measured(0.01, 4.0, Answer.SLOWER),
    ]
    line = speed_checks.table_of_functions(rows)[2]
    assert line == "| 20 steps of the cart-pole | 3 | 0.9 % | 1.0 % | 1 | 1 | 1 |"
    cells = speed_checks.table_of_occasions(rows)[2].split(" | ")
    assert cells[2:5] == ["0.0 %", "65.4 %", "6"]
    assert cells[5:] == ["4", "2", "0 |"]
