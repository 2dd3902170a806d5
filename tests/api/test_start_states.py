"""Start states from a program: a plan, a file, or arrays."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mjbench.api import start_states
from mjbench.errors import InputError
from mjbench.simulation.starts import StartPlan


def test_settling_and_the_default() -> None:
    with start_states.plan(None, None) as plan:
        assert plan == StartPlan()
    with start_states.plan(0.25, None) as plan:
        assert plan == StartPlan(settle_s=0.25)


def test_arrays_lie_in_a_file_as_long_as_they_are_needed() -> None:
    qpos = np.arange(6.0).reshape(3, 2)
    with start_states.plan(None, {"qpos": qpos}) as plan:
        assert plan.file is not None
        np.testing.assert_array_equal(np.load(plan.file)["qpos"], qpos)
        file = plan.file
    assert not file.exists()


def test_a_file_stays(tmp_path: Path) -> None:
    np.savez(tmp_path / "states.npz", qpos=np.zeros((2, 2)))
    with start_states.plan(None, tmp_path / "states.npz") as plan:
        assert plan.file == tmp_path / "states.npz"
    assert (tmp_path / "states.npz").exists()


@pytest.mark.parametrize(
    ("settle_s", "states", "message"),
    [
        (-1.0, None, "settle_s must be at least 0"),
        (None, "missing.npz", "no such file"),
        (None, [1, 2], "states are a path, or arrays"),
        (0.5, {"qpos": [[0.0]]}, "not both"),
        (None, {"file": [[0.0]]}, "cannot be stored as arrays"),
    ],
)
def test_what_is_wrong_is_refused(settle_s: float | None, states: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        start_states.plan(settle_s, states).__enter__()


def test_controls_lie_in_a_file_as_long_as_they_are_needed() -> None:
    with start_states.plan(None, None, [[0.5], [1.0]]) as plan:
        assert plan.controls_file is not None
        np.testing.assert_array_equal(np.load(plan.controls_file), [[0.5], [1.0]])
        file = plan.controls_file
    assert not file.exists()


@pytest.mark.parametrize("actions", ["missing.npz", [["a"]], {"ctrl": 1}, [[1.0], [1.0, 2.0]]])
def test_wrong_controls_are_refused(actions: Any) -> None:
    with pytest.raises(InputError, match=r"no such file|actions cannot be stored"):
        start_states.plan(None, None, actions).__enter__()
