"""Functions of two counts, matched by name: costs, and cost that moved."""

from collections.abc import Iterable
from dataclasses import replace

from example_counts import counted

from mjbench.counts.function_differences import (
    function_differences,
    largest_differences,
    moved_cost,
    moved_groups,
)
from mjbench.counts.records import FunctionDifference


def test_functions_are_sorted_by_contribution() -> None:
    baseline = counted("1.0", a=100.0, b=50.0, left=30.0)
    candidate = counted("2.0", a=90.0, b=50.0, fresh=200.0)
    functions = function_differences(baseline, candidate)
    assert [(f.name, f.old, f.new, f.difference) for f in functions] == [
        ("fresh", None, 200.0, 200.0),
        ("left", 30.0, None, -30.0),
        ("a", 100.0, 90.0, -10.0),
        ("b", 50.0, 50.0, 0.0),
    ]
    assert [net.names for net in largest_differences(functions, 9)] == [["fresh"], ["left"], ["a"]]
    assert len(largest_differences(functions, 1)) == 1


def test_functions_without_names_are_one_for_each_library() -> None:
    baseline, candidate = (
        replace(
            counted(release, **{address: 300.0, "0x9": 60.0}),
            libraries=dict.fromkeys((address, "0x9"), "/a/_structs.cpython.so"),
        )
        for release, address in (("1.0", "0x10"), ("2.0", "0x20"))
    )
    (function,) = function_differences(baseline, candidate)
    assert (function.name, function.old, function.new) == ("_structs (no symbols)", 360.0, 360.0)


def test_moved_cost_is_found_by_the_calls_of_either_release() -> None:
    baseline = counted("1.0", frozenset({("f", "callee")}), f=100.0, callee=900.0)
    functions = function_differences(baseline, counted("2.0", f=1000.0))
    assert {f.name: f.moved_with for f in functions} == {"f": ["callee"], "callee": ["f"]}


def test_a_function_names_those_that_took_over_its_cost_and_not_the_others_that_gave_it_up() -> (
    None
):
    calls = frozenset({("f", "callee"), ("g", "callee"), ("h", "other")})
    baseline = counted("1.0", f=600.0, g=500.0, h=300.0)
    candidate = counted("2.0", calls, f=1.0, g=1.0, callee=1100.0, h=1.0, other=300.0)
    functions = function_differences(baseline, candidate)
    assert {f.name: f.moved_with for f in functions} == {
        "callee": ["f", "g"],
        "f": ["callee"],
        "g": ["callee"],
        "h": ["other"],
        "other": ["h"],
    }
    groups = [[f.name for f in group] for group in moved_groups(functions)]
    assert groups == [["callee", "f", "g"], ["other", "h"]]


def moved(
    differences: dict[str, float],
    calls: Iterable[tuple[str, str]],
    min_cost: float = 1.0,
    rest: float = 10.0,
) -> list[set[str]]:
    """Return the groups, for functions that cost `rest` in the release in which they cost less."""
    functions = {
        name: FunctionDifference(
            name=name, old=rest + max(0.0, -by), new=rest + max(0.0, by), difference=by
        )
        for name, by in differences.items()
    }
    return [set(group) for group in moved_cost(functions, calls, min_cost)]


def test_a_callee_that_is_inlined_moves_its_cost_to_the_caller() -> None:
    calls = [("caller", "callee"), ("caller", "other")]
    differences = {"caller": 95.0, "callee": -100.0, "other": 5.0}
    assert moved(differences, calls) == [{"caller", "callee"}]


def test_several_callees_may_move_to_one_caller_and_one_to_several() -> None:
    several = {"f": 100.0, "g": -60.0, "h": -41.0}
    assert moved(several, [("f", "g"), ("f", "h")]) == [{"f", "g", "h"}]
    assert moved(several, [("g", "f"), ("h", "f")]) == [{"f", "g", "h"}]


def test_nothing_moves_without_a_call() -> None:
    differences = {"f": 100.0, "g": -100.0}
    assert moved(differences, []) == []


def test_a_function_that_changed_in_the_same_direction_has_no_part_in_a_move() -> None:
    differences = {"f": 100.0, "g": -110.0, "h": 10.0}
    groups = moved(differences, [("g", "f"), ("g", "h"), ("f", "h")])
    assert groups == [{"f", "g", "h"}]  # h as a part of what g gave up
    assert moved(differences, [("g", "f"), ("f", "h")]) == [{"f", "g"}]


def test_cost_that_grew_or_that_is_small_did_not_move() -> None:
    calls = [("f", "g")]
    assert moved({"f": 100.0, "g": -50.0}, calls) == []
    assert moved({"f": 100.0, "g": 100.0}, calls) == []
    assert moved({"f": 100.0, "g": -100.0}, calls, min_cost=101.0) == []


def test_a_callee_that_changed_a_little_was_not_inlined() -> None:
    differences, calls = {"f": 100.0, "g": -100.0}, [("f", "g")]
    assert moved(differences, calls, rest=300.0) == [{"f", "g"}]
    assert moved(differences, calls, rest=301.0) == []
