"""What `mjbench profile` prints."""

from dataclasses import replace

from drawn_charts import drawn
from example_records import WORK
from step_profiles import step_profile

from mjbench.commands.profile import show as profile
from mjbench.commands.profile.measure import ProfiledSteps, ProfileRow
from mjbench.commands.profile.model_costs import Cost, CostKind
from mjbench.interval import Interval
from mjbench.results import terminal


def text(of: ProfileRow) -> str:
    return terminal.text_of(profile.sections([of]))


def test_step_stages_and_rendering_are_printed() -> None:
    printed = text(step_profile())
    assert "takes 3 µs: engine 2 µs (67 %), Python 1 µs" in printed
    assert "4 contacts, 0 constraints, 2.5 solver iterations" in printed
    assert "Python package, a step of the loop is 1.20 (1.19–1.21) times as fast" in printed
    assert "kinematics" in printed
    assert "actuation" not in printed  # takes no time
    assert "by egl: 10 ms, as long as 3,333 steps" in printed
    assert "osmesa: not available (it needs libosmesa6)" in printed


def test_a_release_that_installs_no_timer_prints_nothing_about_it() -> None:
    assert "times as fast" not in text(step_profile(has_timer=False))


def test_a_gain_without_the_timer_that_is_not_certain_is_not_shown() -> None:
    row = step_profile()
    assert row.steps is not None
    steps = replace(row.steps, speedup_without_timer=Interval(1.2, 0.99, 1.4))
    assert "times as fast" not in text(replace(row, steps=steps))


def test_where_python_is_within_the_noise_all_of_a_step_is_the_engine() -> None:
    stages = {"collision": 1.0}
    slower = ProfiledSteps(0.002, 2000.0, 2030.0, None, WORK, stages, {})
    for steps in (slower, replace(slower, engine_ns=1900.0, is_python_resolved=False)):
        printed = text(ProfileRow("m", steps=steps, frames=()))
        assert (
            "takes 2 µs: all of it the engine; Python's part is below what was resolved" in printed
        )
        (line,) = [line for line in printed.splitlines() if line.startswith("Python")]
        assert "below what was resolved" in line
        assert "-" not in line


def test_controls_are_held_where_the_model_has_some() -> None:
    def facts(actuators: float | None) -> str:
        work = replace(WORK, actuators=actuators)
        steps = ProfiledSteps(0.002, 2000.0, 1500.0, None, work, {"collision": 1.0}, {})
        return text(ProfileRow("m", steps=replace(steps, run_nstep=5), frames=()))

    held = "Each simulation holds the controls of its start"
    assert held in facts(2.0) and held in facts(None)
    assert held not in facts(0.0)


def test_a_profile_has_a_bar_for_each_stage_that_takes_time() -> None:
    stages = {"collision": 0.6, "velocity": 0.4, "sleep": 0.0}
    steps = ProfiledSteps(0.002, 2000.0, 1500.0, Interval(1.2, 1.1, 1.3), WORK, stages, {})
    (section,) = profile.sections([ProfileRow("m", steps=steps, frames=())])
    (figure,) = section.figures
    assert [row[0] for row in figure.data.rows] == ["collision", "velocity"]
    assert figure.alternative == "Bars of 2 stages; the longest is collision, 60.0 %."
    assert "engine 1.5 µs (75 %)" in section.conclusions[0].text
    assert (
        "the longest stage is collision, 60 % of the engine's time" in section.conclusions[1].text
    )
    assert "1.20 (1.10–1.30) times as fast" in section.conclusions[2].text
    assert "collision" in drawn(section)[0]


def test_static_geoms_are_named_where_kinematics_takes_longest() -> None:
    stages = {"kinematics": 0.6, "velocity": 0.4}
    steps = ProfiledSteps(0.002, 2000.0, 1500.0, None, WORK, stages, {})
    costs = [Cost(CostKind.STATIC, "static geoms", 4901, 0.58)]
    _, stage = profile.conclusions("city", replace(steps, costs=costs))
    assert stage.text.endswith("engine's time; most of it is static geoms (4,901): 58 %")


def test_a_simulated_second_has_a_row_for_each_part() -> None:
    (section,) = profile.sections([step_profile()])
    (table,) = [table for table in section.tables if "simulated time" in table.title]
    assert [row[0] for row in table.rows] == ["physics", "Python", "rendering (egl)"]
