"""Tables of `pytest --benchmark-only`: what is compared with what, and what a group comes to."""

from dataclasses import replace

import benchmark_tables
import pytest
from benchmark_tables import BenchmarkTime
from rich.console import Console

from mjbench.results import terminal

ONE = BenchmarkTime(
    "rollout, by threads: humanoid", "threads=1", "step", 2000, 1990, 2020, 10, True
)
TWO = replace(ONE, variant="threads=2", median_ns=1000, low_ns=990, high_ns=1020)
CARTPOLE = replace(ONE, group="mj_step", variant="cartpole", is_comparable=False)
PILE = replace(CARTPOLE, variant="pile", median_ns=1.2e6, low_ns=1.1e6, high_ns=1.3e6)


def test_each_group_has_a_table_of_its_own() -> None:
    first, second = benchmark_tables.groups([ONE, CARTPOLE, TWO, PILE])
    assert first[0].title == "rollout, by threads: humanoid"
    assert first[0].texts == [
        ["threads=2", "1 µs", "30 ns", "10", "1.00"],
        ["threads=1", "2 µs", "30 ns", "10", "2.00"],
    ]
    assert second[0].title == "mj_step"
    assert [row[-1] for row in second[0].texts] == ["", ""]


@pytest.mark.parametrize(
    ("group", "line"),
    [
        ([ONE, TWO], "threads=2 is the fastest; threads=1 takes 2.00 times as long."),
        (
            [ONE, replace(TWO, median_ns=1999, low_ns=1985, high_ns=2010)],
            "No difference is clear: the quartiles of threads=2 and threads=1 overlap.",
        ),
        (
            [ONE, TWO, replace(TWO, variant="threads=4", median_ns=1010, low_ns=1000)],
            "threads=2 and threads=4 are the fastest, with quartiles that overlap;"
            " threads=1 takes 2.00 times as long.",
        ),
        (
            [CARTPOLE, PILE],
            "A step takes 2 µs (cartpole) to 1.2 ms (pile); they do other work,"
            " so none is the fastest.",
        ),
        ([CARTPOLE], "A step takes 2 µs (cartpole)."),
        ([replace(CARTPOLE, variant="")], "A step takes 2 µs."),
        (
            [ONE, *(replace(TWO, variant=f"threads={n}") for n in range(2, 8))],
            "6 of 7 are the fastest, with quartiles that overlap;"
            " threads=1 takes 2.00 times as long.",
        ),
        (
            [ONE, TWO, replace(TWO, variant="threads=8", median_ns=2500)],
            "threads=2 and threads=8 are the fastest, with quartiles that overlap;"
            " threads=1 takes 2.00 times as long.",
        ),
    ],
)
def test_a_group_ends_with_what_it_comes_to(group: list[BenchmarkTime], line: str) -> None:
    ((_, closing),) = benchmark_tables.groups(group)
    assert closing == line


def test_tables_fit_100_columns() -> None:
    variant = "model=humanoid, threads=16, data=persistent"
    ((table, _),) = benchmark_tables.groups([ONE, replace(TWO, variant=variant)])
    (printed,) = terminal.table_parts(table, benchmark_tables.WIDTH)
    assert Console().measure(printed).maximum <= benchmark_tables.WIDTH
