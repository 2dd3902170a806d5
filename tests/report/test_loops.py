"""Reports of what commands around one loop measure."""

from collections.abc import Sequence

import numpy as np
import pytest
from example_records import WORK

from mjbench.comparison.planner import Algorithm
from mjbench.comparison.planning_run import PlanningRow
from mjbench.loop import latency
from mjbench.loop import profile as loop_profile
from mjbench.loop.latency import Pace, StepSamples
from mjbench.loop.overhead import HabitCost, OverheadRow
from mjbench.loop.profile import StepTimes
from mjbench.report import charts, overhead, planning, profile
from mjbench.report import latency as report
from mjbench.report.content import Section, Tone
from mjbench.status import Status

COSTS = (
    HabitCost("data.site('tip').xpos", 900.0, 850.0, 950.0, 0.5, "bind once", 800.0, "code"),
    HabitCost("np.copy", 300.0, 280.0, 320.0, 0.2, "", None, "code"),
)


def drawn(section: Section) -> list[str]:
    """Return the charts of a section, drawn."""
    pytest.importorskip("vl_convert")
    return [charts.svg(figure.specification) for figure in section.figures]


def test_a_loops_waste_begins_where_the_bare_loop_ends() -> None:
    table = OverheadRow("m", Status.OK, "", 1800.0, 1200.0, 200.0, 500, COSTS)
    rows = [table, OverheadRow("broken", Status.FAILED, "it crashed")]
    section, failed = overhead.sections(rows)
    assert [c.text for c in failed.conclusions] == ["broken: failed: it crashed"]
    (figure,) = section.figures
    assert figure.data.rows[0] == ("engine", 0.0, 1200.0, "step")
    assert figure.data.rows[2] == ("+ data.site('tip').xpos", 1800.0, 2700.0, "habit")
    assert "`bind once` does the same for less" in section.conclusions[1].text
    (svg,) = drawn(section)
    assert "engine" in svg
    assert len(section.tables[0].rows) == 2


def test_a_profile_has_a_bar_for_each_stage_that_takes_time() -> None:
    stages = {"collision": 0.6, "velocity": 0.4, "sleep": 0.0}
    steps = StepTimes(0.002, 2000.0, 1500.0, 400.0, WORK, stages, {})
    (section,) = profile.sections([loop_profile.row("m", steps, ())])
    (figure,) = section.figures
    assert [row[0] for row in figure.data.rows] == ["collision", "velocity"]
    assert figure.alternative == "Bars of 2 stages; the longest is collision, 60.0 %."
    assert "engine 1.5 µs (75 %)" in section.conclusions[0].text
    assert "timer of MuJoCo's Python package takes 20 %" in section.conclusions[1].text
    assert "collision" in drawn(section)[0]


def samples(pace: Pace, latency_ns: Sequence[float]) -> StepSamples:
    rate = 500.0 if pace == Pace.PACED else None
    return StepSamples(pace, rate, 0.002, WORK, np.asarray(latency_ns), {})


def test_latency_is_drawn_as_far_as_there_are_steps() -> None:
    ns = np.linspace(10_000, 20_000, 999).tolist()
    rows = [
        latency.row("m", samples(Pace.FREE, [*ns, 3e6]), None),
        latency.row("m", samples(Pace.PACED, [*ns, 20_000.0]), None),
    ]
    (section,) = report.sections(rows)
    assert [c.tone for c in section.conclusions] == [Tone.BAD, Tone.GOOD]
    assert "1 of 1,000 steps missed 2 ms" in section.conclusions[0].text
    (figure,) = section.figures
    steps = [row[0] for row in figure.data.rows]
    assert max(float(step or 0) for step in steps) == pytest.approx(1000, rel=0.3)
    assert "free-running" in drawn(section)[0]


def test_plans_that_differ_come_first() -> None:
    fields = {"model": "m", "algorithm": Algorithm.MPPI, "samples": 4, "horizon": 10}
    rows = [
        PlanningRow(**fields, path="python_loop", options={}, plan_s=0.1, plans_per_s=10.0,
                    speedup=1.0),
        PlanningRow(**fields, path="rollout", options={}, status=Status.DISAGREES, detail="wrong"),
    ]  # fmt: skip
    (section,) = planning.sections(rows)
    assert section.conclusions[0].tone == Tone.BAD
    assert "m: fastest here is python_loop, 10 plans per second" in section.conclusions[1].text
    assert len(section.tables[0].rows) == 2
