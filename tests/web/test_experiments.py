"""Sines and cosines against this system's C library."""

import math

from mjbench.web import experiments
from mjbench.web.messages import Rotated
from mjbench.web.records import Mathematics


def rotated(angles: list[float], sine: float = 0.0) -> Rotated:
    return Rotated([(math.cos(a / 2), 0.0, 0.0, math.sin(a / 2) + sine) for a in angles])


def test_the_librarys_own_values_do_not_differ() -> None:
    angles = [0.1, -2.0, 3.0]
    assert experiments.mathematics(angles, rotated(angles)) == Mathematics(3, 0, 0, 0.0)


def test_differences_are_counted_by_function() -> None:
    angles = [0.1, 2.0]
    mathematics = experiments.mathematics(angles, rotated(angles, sine=1e-9))
    assert (mathematics.sines, mathematics.cosines) == (2, 0)
    assert math.isclose(mathematics.difference, 1e-9, rel_tol=1e-6)
