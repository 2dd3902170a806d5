"""What the habits of a loop come to."""

from dataclasses import replace

from drawn_charts import drawn

from mjbench.commands.profile import habit_costs
from mjbench.commands.profile.habit_timing import HabitCost, OverheadRow
from mjbench.status import Status

COSTS = (
    HabitCost("data.site('tip').xpos", 900.0, 850.0, 950.0, 0.5, "bind once", 800.0, "code"),
    HabitCost("np.copy", 300.0, 280.0, 320.0, 0.2, "", None, "code"),
)


def test_a_loops_waste_begins_where_the_bare_loop_ends() -> None:
    table = OverheadRow("m", Status.OK, "", 1800.0, 1200.0, 200.0, 500, COSTS)
    rows = [table, OverheadRow("broken", Status.FAILED, "it crashed")]
    section, failed = habit_costs.sections(rows)
    assert [c.text for c in failed.conclusions] == ["broken: failed: it crashed"]
    (figure,) = section.figures
    assert figure.data.rows[0] == ("engine", 0.0, 1200.0, "step")
    assert figure.data.rows[2] == ("+ data.site('tip').xpos", 1800.0, 2700.0, "habit")
    assert "`bind once` does the same for less" in section.conclusions[0].text
    unsure, sure = replace(COSTS[0], low=-9.0), COSTS[1]
    for costs, sentence in (
        (
            (unsure, sure),
            "m: of the habits that certainly cost time, the most expensive is np.copy",
        ),
        ((unsure,), "m: no habit certainly costs anything: give a longer --budget"),
    ):
        (noisy,) = habit_costs.sections([replace(table, costs=costs)])
        assert noisy.conclusions[0].text.startswith(sentence)
    (svg,) = drawn(section)
    assert "engine" in svg
    assert len(section.tables[0].rows) == 2
