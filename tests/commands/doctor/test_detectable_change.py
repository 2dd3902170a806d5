"""How small a change a machine can decide: what is said of it holds, simulated."""

import math
import random

import pytest

from mjbench.commands.doctor.detectable_change import Noise
from mjbench.paired.outcomes import Verdict
from mjbench.paired.verdict import VerdictPlan, judge


def test_more_noise_and_longer_launches_need_larger_changes() -> None:
    sizes = [Noise(20, deviation, 0.5, 1.0).decidable for deviation in (0.001, 0.01, 0.1)]
    assert sizes == sorted(sizes)
    assert Noise(20, 0.01, 5.0, 1.0).decidable > sizes[1]


@pytest.mark.parametrize(("deviation", "launch_s"), [(0.003, 1.0), (0.01, 0.5), (0.02, 1.5)])
def test_changes_of_the_decidable_size_are_decided(deviation: float, launch_s: float) -> None:
    rng = random.Random(0)
    size = Noise(20, deviation, launch_s, 1.0).decidable
    decided = 0
    for _ in range(200):
        count = int(60 / launch_s)
        launches = [rng.gauss(math.log1p(size), deviation) for _ in range(count)]
        verdict = judge(launches, VerdictPlan(size, precision=1e-6)).verdict
        decided += verdict == Verdict.SLOWER
    assert decided >= 0.98 * 200
