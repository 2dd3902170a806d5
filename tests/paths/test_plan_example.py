"""docs/examples/plan.py: a sampling planner that swings up the cart-pole."""

from types import ModuleType

import numpy as np
import pytest
from commands import load_example


@pytest.fixture(scope="module")
def plan() -> ModuleType:
    return load_example("plan")


def test_the_pole_stands_at_the_end(plan: ModuleType, capsys: pytest.CaptureFixture[str]) -> None:
    plan.main(3.0)
    assert "the pole stands in the last quarter" in capsys.readouterr().out


def test_the_plan_is_the_same_on_one_thread_and_on_two(plan: ModuleType) -> None:
    of_one, of_two = (plan.swing_up(0.2, threads)[0] for threads in (1, 2))
    np.testing.assert_array_equal(of_one, of_two)


def test_a_plan_of_too_little_time_is_told_to_fail(
    plan: ModuleType, capsys: pytest.CaptureFixture[str]
) -> None:
    plan.main(0.04)
    assert "the pole does not stand" in capsys.readouterr().out
