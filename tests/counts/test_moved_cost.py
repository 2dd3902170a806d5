"""Cost that moved between a caller and its callees, told from cost that changed."""

from collections.abc import Iterable

from mjbench.counts.moved_cost import moved_cost
from mjbench.counts.records import CodeChange

CHANGED, IDENTICAL, GONE = CodeChange.CHANGED, CodeChange.IDENTICAL, CodeChange.GONE


def moved(
    differences: dict[str, float],
    calls: Iterable[tuple[str, str]],
    min_cost: float = 1.0,
    rest: float = 10.0,
    **changes: CodeChange,
) -> list[set[str]]:
    """Return the groups, for functions that cost `rest` in the release in which they cost less."""
    costs = {name: (rest + max(0.0, -by), rest + max(0.0, by)) for name, by in differences.items()}
    return [set(group) for group in moved_cost(costs, changes, calls, min_cost)]


def test_a_callee_that_is_inlined_moves_its_cost_to_the_caller() -> None:
    calls = [("caller", "callee"), ("caller", "other")]
    differences = {"caller": 95.0, "callee": -100.0, "other": 5.0}
    assert moved(differences, calls, caller=CHANGED, callee=GONE) == [{"caller", "callee"}]


def test_a_callee_that_remains_for_other_callers_may_be_identical() -> None:
    differences = {"caller": 95.0, "callee": -100.0}
    calls = [("caller", "callee")]
    assert moved(differences, calls, caller=CHANGED, callee=IDENTICAL) == [{"caller", "callee"}]


def test_several_callees_may_move_to_one_caller_and_one_to_several() -> None:
    several = {"f": 100.0, "g": -60.0, "h": -41.0}
    assert moved(several, [("f", "g"), ("f", "h")], f=CHANGED) == [{"f", "g", "h"}]
    assert moved(several, [("g", "f"), ("h", "f")], g=CHANGED, h=CHANGED) == [{"f", "g", "h"}]


def test_nothing_moves_without_a_call_or_without_changed_code() -> None:
    differences = {"f": 100.0, "g": -100.0}
    assert moved(differences, [], f=CHANGED, g=CHANGED) == []
    assert moved(differences, [("f", "g")], f=IDENTICAL, g=CHANGED) == []


def test_a_function_that_changed_in_the_same_direction_has_no_part_in_a_move() -> None:
    differences = {"f": 100.0, "g": -110.0, "h": 10.0}
    groups = moved(differences, [("g", "f"), ("g", "h"), ("f", "h")], f=CHANGED, g=CHANGED)
    assert groups == [{"f", "g", "h"}]  # h as a part of what g gave up
    assert moved(differences, [("g", "f"), ("f", "h")], f=CHANGED, g=CHANGED) == [{"f", "g"}]


def test_cost_that_grew_or_that_is_small_did_not_move() -> None:
    calls = [("f", "g")]
    assert moved({"f": 100.0, "g": -50.0}, calls, f=CHANGED) == []
    assert moved({"f": 100.0, "g": 100.0}, calls, f=CHANGED) == []
    assert moved({"f": 100.0, "g": -100.0}, calls, min_cost=101.0, f=CHANGED) == []


def test_a_callee_that_changed_a_little_was_not_inlined() -> None:
    differences, calls = {"f": 100.0, "g": -100.0}, [("f", "g")]
    assert moved(differences, calls, rest=300.0, f=CHANGED) == [{"f", "g"}]
    assert moved(differences, calls, rest=301.0, f=CHANGED) == []
