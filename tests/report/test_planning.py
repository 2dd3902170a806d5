"""What planning by several paths comes to."""

from mjbench.comparison.planning_run import PlanningRow
from mjbench.comparison.sampling_planners import Algorithm
from mjbench.report import planning
from mjbench.report.content import Tone
from mjbench.status import Status


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
