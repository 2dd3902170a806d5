"""Functions of two counts, matched: costs, code, names, and cost that moved."""

from dataclasses import replace

from mjbench.counts.callgrind import CodePlace
from mjbench.counts.function_differences import (
    CodeChanges,
    code_shares,
    function_differences,
    is_different,
    moved_groups,
)
from mjbench.counts.instructions import ModelCount
from mjbench.counts.records import CodeChange, FunctionCount


def counted(
    release: str, calls: frozenset[tuple[str, str]] = frozenset(), **functions: float
) -> ModelCount:
    return ModelCount(
        model="pile",
        release=release,
        instructions_per_step=sum(functions.values()),
        functions=[FunctionCount(name, cost, cost) for name, cost in functions.items()],
        calls=calls,
    )


def test_functions_are_sorted_by_contribution() -> None:
    baseline = counted("1.0", a=100.0, b=50.0, left=30.0)
    candidate = counted("2.0", a=90.0, b=50.0, fresh=200.0)
    functions = function_differences(baseline, candidate, None)
    assert [(f.name, f.old, f.new, f.difference, f.code) for f in functions] == [
        ("fresh", None, 200.0, 200.0, None),
        ("left", 30.0, None, -30.0, None),
        ("a", 100.0, 90.0, -10.0, None),
        ("b", 50.0, 50.0, 0.0, None),
    ]


def test_a_renamed_function_is_one_function() -> None:
    code = CodeChanges({"mj_f": CodeChange.IDENTICAL}, {"mj_f": "f"})
    (function,) = function_differences(counted("1.0", f=100.0), counted("2.0", mj_f=120.0), code)
    assert (function.name, function.old_name, function.difference) == ("mj_f", "f", 20.0)


def test_functions_without_names_are_one_for_each_library() -> None:
    place = CodePlace("/a/_structs.cpython.so", (8,))
    baseline, candidate = (
        replace(
            counted(release, **{address: 300.0, "0x9": 60.0}),
            places=dict.fromkeys((address, "0x9"), (place,)),
        )
        for release, address in (("1.0", "0x10"), ("2.0", "0x20"))
    )
    (function,) = function_differences(baseline, candidate, CodeChanges())
    assert (function.name, function.old, function.new) == ("_structs (no symbols)", 360.0, 360.0)
    assert function.code is CodeChange.UNKNOWN


def test_code_that_changed_is_a_difference_even_at_the_same_cost() -> None:
    count = counted("1.0", a=1.0, b=1.0, c=1.0)
    code = CodeChanges(
        {"a": CodeChange.CHANGED, "b": CodeChange.OFFSETS, "c": CodeChange.IDENTICAL}
    )
    functions = function_differences(count, count, code)
    assert [function.name for function in functions if is_different(function)] == ["a"]


def test_shares_are_of_the_instructions_of_both_releases() -> None:
    baseline, candidate = counted("1.0", a=60.0, b=40.0), counted("2.0", a=60.0, c=40.0)
    code = CodeChanges({"a": CodeChange.IDENTICAL, "b": CodeChange.GONE, "c": CodeChange.NEW})
    shares = code_shares(function_differences(baseline, candidate, code))
    assert {change: (s.functions, s.share) for change, s in shares.items()} == {
        CodeChange.IDENTICAL: (1, 0.6),
        CodeChange.NEW: (1, 0.2),
        CodeChange.GONE: (1, 0.2),
    }


def test_moved_cost_is_found_by_the_calls_of_either_release() -> None:
    baseline = counted("1.0", frozenset({("f", "callee")}), f=100.0, callee=900.0)
    candidate = counted("2.0", mj_f=1000.0)
    code = CodeChanges({"mj_f": CodeChange.CHANGED, "callee": CodeChange.GONE}, {"mj_f": "f"})
    functions = function_differences(baseline, candidate, code)
    assert {f.name: f.moved_with for f in functions} == {"mj_f": ["callee"], "callee": ["mj_f"]}


def test_a_function_names_those_that_took_over_its_cost_and_not_the_others_that_gave_it_up() -> (
    None
):
    calls = frozenset({("f", "callee"), ("g", "callee"), ("h", "other")})
    baseline = counted("1.0", f=600.0, g=500.0, h=300.0)
    candidate = counted("2.0", calls, f=1.0, g=1.0, callee=1100.0, h=1.0, other=300.0)
    code = CodeChanges(dict.fromkeys("fgh", CodeChange.CHANGED))
    functions = function_differences(baseline, candidate, code)
    assert {f.name: f.moved_with for f in functions} == {
        "callee": ["f", "g"],
        "f": ["callee"],
        "g": ["callee"],
        "h": ["other"],
        "other": ["h"],
    }
    groups = [[f.name for f in group] for group in moved_groups(functions)]
    assert groups == [["callee", "f", "g"], ["other", "h"]]
