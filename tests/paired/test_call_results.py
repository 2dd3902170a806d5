"""What functions returned: which results are the same, rounding, or other work."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import mujoco
import numpy as np
import pytest

from mjbench.paired import call_results
from mjbench.paired.call_results import ResultsDifference
from mjbench.paired.outcomes import ResultsOutcome


@dataclass
class Observation:
    qpos: np.ndarray
    names: list[str] = field(default_factory=lambda: ["hip"])


def check(old: Sequence[Any], new: Sequence[Any]) -> ResultsDifference:
    """Compare the results of calls."""
    return call_results.compare(
        [call_results.leaves(each) for each in old], [call_results.leaves(each) for each in new]
    )


@pytest.mark.parametrize(
    "result",
    [
        *(1, 2.5, "text", b"bytes", (1, 2), [1.0, [2, "x"]], {"a": 1, "b": [np.zeros(3)]}),
        *(np.arange(6).reshape(2, 3), np.float32(2), np.array([1.0, np.nan]), float("nan")),
        Observation(np.arange(3.0)),
    ],
)
def test_equal_results_are_the_same(result: Any) -> None:
    assert check([result], [result]) == ResultsDifference(ResultsOutcome.SAME)


@pytest.mark.parametrize(
    ("old", "new", "detail"),
    [
        (1, 2, "call 1 returns 2 instead of 1"),
        ("a", "b", "call 1 returns 'b' instead of 'a'"),
        (np.zeros(2), np.zeros(3), "shape (3,) instead of (2,)"),
        (np.array([0.0, 1.0]), np.array([0.0, 1.1]), "[1] 1.1 instead of 1.0"),
        (np.zeros(2), np.array([0.0, 1e-9]), "[1] 1e-09 instead of 0.0"),
        (np.array([0.0, 1.0]), np.array([np.nan, 1.0]), "[0] nan instead of 0.0"),
        ({"a": 1}, {"b": 1}, "its parts are others"),
        ([1.0, "x"], [1.0, "y"], "[1]: 'y' instead of 'x'"),
        (1.0, "x", "'x' instead of an array of shape ()"),
        (None, 1.0, "its parts are others"),
        (Observation(np.ones(2)), Observation(np.zeros(2)), "qpos: [0] 0.0 instead of 1.0"),
        (10**6, 10**6 + 1, "1000001 instead of 1000000"),  # whole numbers are not rounded
    ],
)
def test_other_results_are_named(old: Any, new: Any, detail: str) -> None:
    result = check([old], [new])
    assert result.outcome == ResultsOutcome.DIFFERENT
    assert detail in result.detail


def test_the_call_that_differs_is_named() -> None:
    assert "call 3 returns" in check([1, 2, 3], [1, 2, 4]).detail


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (1.0, 1.0 + 1e-12),
        (np.float32(1.0), np.float32(1.0 + 1e-6)),
        (np.zeros(3), np.array([0.0, 1e-18, 0.0])),
    ],
)
def test_rounding_is_no_other_result(old: Any, new: Any) -> None:
    result = check([old], [new])
    assert result.outcome == ResultsOutcome.ROUNDING
    assert result.detail.startswith("they differ by ")


def test_large_arrays_are_compared_bit_by_bit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(call_results, "_MOST_BYTES", 8)
    values = np.arange(4.0)
    assert check([values], [values.copy()]).outcome == ResultsOutcome.SAME
    unknown = check([values], [values + 1e-15])
    assert unknown.outcome == ResultsOutcome.NONE
    assert "call 1 returns other bits, in an array that is too large to tell" in unknown.detail
    assert check([values], [values.astype(np.float32)]).outcome == ResultsOutcome.NONE


def test_large_arrays_of_other_shapes_or_whole_numbers_differ(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(call_results, "_MOST_BYTES", 8)
    whole = np.arange(4)
    for old, new in ((np.zeros(4), np.zeros(5)), (whole, whole + 1)):
        assert check([old], [new]).outcome == ResultsOutcome.DIFFERENT


def test_another_part_that_differs_outweighs_a_large_array(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(call_results, "_MOST_BYTES", 8)
    values = np.arange(4.0)
    result = check([[values, "a"]], [[values + 1e-15, "b"]])
    assert result.outcome == ResultsOutcome.DIFFERENT
    assert "[1]: 'b' instead of 'a'" in result.detail


def test_the_state_of_data_is_compared() -> None:
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body><freejoint/><geom size='.1'/></body></worldbody></mujoco>"
    )
    old, new = mujoco.MjData(model), mujoco.MjData(model)
    assert check([old], [new]).outcome == ResultsOutcome.SAME
    mujoco.mj_step(model, new)
    assert "time: " in check([old], [new]).detail


def test_a_result_is_kept_as_it_was_returned() -> None:
    values = np.zeros(2)
    leaves = call_results.leaves(values)
    values[:] = 1.0
    assert np.array_equal(leaves[0].value, np.zeros(2))


def test_without_results_nothing_is_compared() -> None:
    assert check([None], [None]).outcome == ResultsOutcome.NONE


@pytest.mark.parametrize("result", [object(), lambda: None])
def test_what_cannot_be_compared_is_refused(result: Any) -> None:
    with pytest.raises(TypeError, match="is no number, text, array or container of them"):
        call_results.leaves(result)


def test_containers_that_hold_themselves_are_refused() -> None:
    endless: list[Any] = []
    endless.append(endless)
    with pytest.raises(TypeError, match="too deep"):
        call_results.leaves(endless)
