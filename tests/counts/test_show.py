"""Tables of instruction counts: what they list, and what they sum up."""

from collections.abc import Iterable
from dataclasses import replace

from example_counts import counted

from mjbench.counts import show as counts
from mjbench.counts.explain import explain_change
from mjbench.counts.instructions import ModelCount
from mjbench.counts.records import FunctionDifference
from mjbench.results import terminal
from mjbench.results.content import Section
from mjbench.status import Status


def explanation(baseline: ModelCount, candidate: ModelCount) -> list[str]:
    return lines_of(counts.explanations([explain_change(baseline, candidate, None)], top=1))


def lines_of(sections: Iterable[Section]) -> list[str]:
    return terminal.text_of(sections).splitlines()


CRASHED = ModelCount(model="pile", release="2.0", status=Status.CRASHED, detail="signal 11")


def test_counts_list_as_many_functions_as_asked() -> None:
    lines = lines_of(counts.sections([counted("1.0", a=3000.0, b=1000.0), CRASHED], top=1))
    assert lines[2].split() == ["pile", "1.0", "4,000", "1"]
    assert lines[3].split() == ["pile", "2.0", "signal", "11"]
    assert "solver 100.0 %" in lines
    assert lines[-1].split() == ["a", "3,000", "75.0", "%", "3,000"]


def test_differences_that_are_not_listed_are_summed_up() -> None:
    baseline = counted("1.0", a=3000.0, b=1000.0, c=500.0)
    candidate = counted("2.0", a=4000.0, b=970.0, d=30.0)
    lines = explanation(baseline, candidate)
    assert ["solver", "4,500", "5,000", "+500"] in [line.split() for line in lines]
    assert lines[-2].split() == ["a", "3,000", "4,000", "+1,000"]
    assert lines[-1] == "3 further functions: -500 (-10.00 %)"


def test_a_failed_count_is_explained_by_its_detail() -> None:
    assert explanation(counted("1.0", a=1.0), CRASHED)[-1].endswith("MuJoCo 2.0: signal 11")


def test_cost_that_moved_stands_beside_a_function() -> None:
    count = counted("1.0", a=3000.0)
    function = FunctionDifference(
        name="mj_f", old=900.0, new=100.0, difference=-800.0, moved_with=["mj_g", "mj_h"]
    )
    row = replace(explain_change(count, count, None), functions=[function])
    last_line = lines_of(counts.explanations([row], top=1))[-1]
    assert last_line.split("  ")[-1] == "moved to mj_g, mj_h"
