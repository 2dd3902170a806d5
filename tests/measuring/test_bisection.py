"""The first slower version of a row, found from log ratios of which the truth is known."""

import random
from dataclasses import replace

import numpy as np
import pytest

from mjbench.measuring.bisection import ChangePosterior, VersionRatio

CHANGE, DEVIATION = 0.05, 0.01


def find(truth: int, count: int, rng: random.Random, unable: set[int]) -> ChangePosterior:
    """Measure versions until one is likely enough."""
    point = ChangePosterior(count, CHANGE, DEVIATION)
    while point.certainty < 0.99:
        version = point.next_version(unable)
        if version is None:
            break
        log_ratio = CHANGE * (version >= truth) + rng.gauss(0, DEVIATION)
        point = replace(point, observations=[*point.observations, VersionRatio(version, log_ratio)])
    return point


@pytest.mark.parametrize("count", [1, 2, 3, 42, 64])
def test_the_first_slower_version_is_found(count: int) -> None:
    rng = random.Random(count)
    wrong = 0
    for _ in range(15):
        truth = rng.randrange(1, count + 1)
        point = find(truth, count, rng, set())
        wrong += point.likeliest != truth
        assert len(point.observations) <= 10 + 2 * (count > 1)
    assert wrong == 0


def test_the_middle_is_measured_first() -> None:
    assert ChangePosterior(64, CHANGE, DEVIATION).next_version() == 32


def test_versions_that_cannot_be_measured_are_left_out() -> None:
    point = find(20, 40, random.Random(1), unable={20})
    measured = {each.version for each in point.observations}
    assert 20 not in measured
    assert point.certainty < 0.99 or point.likeliest in (20, 21)


def test_without_a_version_to_measure_the_search_ends() -> None:
    assert ChangePosterior(2, CHANGE, DEVIATION).next_version(unable={1}) is None


def test_an_outlier_does_not_decide() -> None:
    rng = random.Random(5)
    point = ChangePosterior(8, CHANGE, DEVIATION, [VersionRatio(4, 10 * CHANGE)])
    for _ in range(6):
        log_ratio = rng.gauss(0, DEVIATION)
        point = replace(point, observations=[*point.observations, VersionRatio(4, log_ratio)])
    assert point.likeliest > 4


def test_probabilities_sum_to_one_and_begin_equal() -> None:
    assert np.allclose(ChangePosterior(5, CHANGE, DEVIATION).probabilities, 0.2)


@pytest.mark.parametrize(
    ("log_ratio", "expected"), [(0.0, False), (0.05, False), (0.026, True), (0.045, False)]
)
def test_a_level_between_two_is_known_as_such(log_ratio: float, expected: bool) -> None:
    assert ChangePosterior(8, CHANGE, 0.005).is_between(log_ratio) is expected
    assert ChangePosterior(8, -CHANGE, 0.005).is_between(-log_ratio) is expected
    assert not ChangePosterior(8, CHANGE, 0.02).is_between(log_ratio)
