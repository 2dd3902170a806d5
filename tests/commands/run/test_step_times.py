"""How long steps and iterations take follows from the records of the step clock."""

import numpy as np
import pytest

from mjbench.commands.run.step_times import Durations


def test_durations_say_how_many_were_late_and_how_they_changed() -> None:
    growing = np.array([*([1e4] * 10), *([2e4] * 80), 9e4, *([4e4] * 9)])
    seen = Durations.of(growing)
    assert seen is not None
    assert (seen.count, seen.p50_ns, seen.max_ns) == (100, 2e4, 9e4)
    assert (seen.early_ns, seen.end_ns) == (1e4, 4e4)
    assert (seen.late_ns, seen.late) == (pytest.approx(3e4), 10)


def test_means_vary_by_parts_in_the_order_of_time() -> None:
    slow_together = Durations.of(np.array([1e4, 3e4] * 5).repeat(10))
    alternating = Durations.of(np.array([1e4, 3e4] * 50))
    assert slow_together is not None
    assert alternating is not None
    assert slow_together.mean_error == pytest.approx((1e4 / 2e4) * (10 / 9) ** 0.5 / 10**0.5)
    assert alternating.mean_error == pytest.approx(0.0)
    few = Durations.of(np.array([1e4, 3e4]))
    assert few is not None
    assert few.mean_error == 0.0


def test_of_nothing_there_are_no_durations() -> None:
    assert Durations.of(np.empty(0)) is None
