"""Callgrind's format: compressed names, relative positions, calls and recursion."""

import pytest
from callgrind_dump import DUMP, DUMP_WITH_LIBRARIES
from hypothesis import given, settings
from hypothesis import strategies as st

from mjbench.counts import callgrind
from mjbench.errors import MachineError


def test_a_dump_is_read_with_compressed_names_and_relative_positions() -> None:
    profile = callgrind.parse(DUMP)
    assert profile.self_cost == {
        "main": 5,
        "mj_step": 150,
        "mj_forward": 50,
        "mj_collision": 500,
        "mj_solNewton": 300,
    }
    assert profile.total == 1005
    assert profile.inclusive_cost["mj_step"] == 1000
    assert profile.inclusive_cost["mj_collision"] == 500


def test_a_dump_names_the_library_of_each_function() -> None:
    profile = callgrind.parse(DUMP_WITH_LIBRARIES)
    assert profile.self_cost == {"main": 5, "mj_step": 86, "memcpy": 9}
    assert profile.arcs == {("main", "mj_step"): 90, ("mj_step", "memcpy"): 5}
    assert profile.libraries == {
        "main": "",
        "mj_step": "/lib/libmujoco.so",
        "memcpy": "/lib/libc.so.6",
    }


def test_the_sum_of_two_dumps_has_the_costs_of_both() -> None:
    profile = callgrind.parse(DUMP_WITH_LIBRARIES)
    both = profile + profile
    assert both.total == 2 * profile.total
    assert both.arcs == {arc: 2 * cost for arc, cost in profile.arcs.items()}
    assert both.libraries == profile.libraries


def test_functions_of_the_engine_are_those_that_mj_step_reaches() -> None:
    profile = callgrind.parse(DUMP)
    counts = profile.counts(profile.reachable_from("mj_step"), repeats=10)
    assert [(count.name, count.self, count.inclusive) for count in counts] == [
        ("mj_collision", 50, 50),
        ("mj_solNewton", 30, 30),
        ("mj_step", 15, 100),
        ("mj_forward", 5, 85),
    ]


def test_recursion_is_not_counted_twice() -> None:
    text = DUMP + "fn=(6) mju_sort'2\n60 7\ncfn=(7) mju_sort\ncalls=1 60\n61 3\n"
    profile = callgrind.parse(text)
    assert profile.self_cost["mju_sort"] == 7
    assert profile.inclusive_cost["mju_sort"] == 7


def test_functions_that_call_each_other_are_listed_once() -> None:
    calls_back = "fn=(5)\ncfn=(3)\ncalls=1 30\n51 20\n"
    names = callgrind.parse(DUMP + calls_back).reachable_from("mj_forward")
    assert names == {"mj_collision", "mj_forward", "mj_solNewton"}


@pytest.mark.parametrize(
    ("symbol", "name"),
    [
        ("mj_step", "mj_step"),
        ("mj_rne'2", "mj_rne"),
        ("mju_dot.constprop.0", "mju_dot"),
        ("(below main)", "(below main)"),
        ("__libc_start_main@@GLIBC_2.34", "__libc_start_main@@GLIBC_2.34"),
        ("mjCModel::TryCompile(mjModel_*&, mjData_*&, mjVFS_ const*)", "mjCModel::TryCompile"),
        ("(anonymous namespace)::parse(int)", "{anonymous}::parse"),
        ("std::__1::vector<double, a<b> > f::read<double>(char*)", "f::read"),
        ("bool std::__1::set<a>::find<b<c> >(b<c> const&) const", "std::set::find"),
        ("operator new(unsigned long)", "operator new"),
        ("void* operator new[](unsigned long)", "operator new[]"),
        ("a::B::operator()(int) const", "a::B::operator()"),
        ("bool std::__1::operator< <char>(a const&, b)", "std::operator<"),
        ("a<c>& std::__1::operator>><c>(a<c>&, b<d>&)", "std::operator>>"),
        ("a std::operator<=><b>(c, d)", "std::operator<=>"),
        ("a::B::operator[](int) const", "a::B::operator[]"),
        ("a::B::operator double() const", "a::B::operator double"),
        ("a::{lambda(int)#1}::operator()(int) const", "a::{lambda#1}::operator()"),
        ("a::B<c>::operator()[abi:ne200100](void const*) const", "a::B::operator()"),
        ("std::__1::f[abi:v15000]<int>(int)", "std::f"),
    ],
)
def test_a_name_is_that_of_the_source_without_types(symbol: str, name: str) -> None:
    assert callgrind.source_name(symbol) == name


LINES = [
    "positions: line",
    "ob=(7) a.so",
    "fn=(7) mj_step",
    "fn=(7)",
    "fn=(9)",
    "cfn=(8) f",
    "calls=1 2",
    "20 100",
    "+1",
    "* x",
    "fn=",
    "",
]


@settings(deadline=None)
@given(text=st.one_of(st.text(), st.lists(st.sampled_from(LINES)).map("\n".join)))
def test_any_text_is_a_profile_or_an_error_of_the_machine(text: str) -> None:
    try:
        profile = callgrind.parse(text)
    except MachineError as error:
        assert "\n" not in str(error)
        return
    assert all(profile.reachable_from(name) for name in profile.self_cost)
