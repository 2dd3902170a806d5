"""Tables of instruction counts: what they list, and what they sum up."""

import pytest

from mjbench.counts.instructions import ModelCount
from mjbench.counts.records import FunctionCount
from mjbench.report import counts, tables
from mjbench.status import Status


def counted(release: str, **functions: float) -> ModelCount:
    total = sum(functions.values())
    return ModelCount(
        model="pile",
        release=release,
        instructions_per_step=total,
        outside_per_step=1.0,
        functions=[FunctionCount(name, cost, cost) for name, cost in functions.items()],
        stages={"solver": total, "sensors": 0.0},
    )


CRASHED = ModelCount(model="pile", release="2.0", status=Status.CRASHED, detail="signal 11")


def test_counts_list_as_many_functions_as_asked(capsys: pytest.CaptureFixture[str]) -> None:
    counts.print_counts(tables.console(), [counted("1.0", a=3000.0, b=1000.0), CRASHED], top=1)
    lines = capsys.readouterr().out.splitlines()
    assert lines[1].split() == ["pile", "1.0", "4,000", "1"]
    assert lines[2].split() == ["pile", "2.0", "signal", "11"]
    assert "solver 100.0 %" in lines
    assert lines[-1].split() == ["a", "3,000", "75.0", "%", "3,000"]


def test_differences_that_are_not_listed_are_summed_up(capsys: pytest.CaptureFixture[str]) -> None:
    baseline = counted("1.0", a=3000.0, b=1000.0, c=500.0)
    candidate = counted("2.0", a=4000.0, b=970.0, d=30.0)
    counts.print_explanation(tables.console(), baseline, candidate, None, top=1)
    lines = capsys.readouterr().out.splitlines()
    assert ["solver", "4,500", "5,000", "+500"] in [line.split() for line in lines]
    assert lines[-2].split() == ["a", "3,000", "4,000", "+1,000"]
    assert lines[-1] == "3 further functions: -500 (-10.00 %)"


def test_a_failed_count_is_explained_by_its_detail(capsys: pytest.CaptureFixture[str]) -> None:
    counts.print_explanation(tables.console(), counted("1.0", a=1.0), CRASHED, None, top=1)
    assert capsys.readouterr().out.splitlines()[-1] == "MuJoCo 2.0: signal 11"
