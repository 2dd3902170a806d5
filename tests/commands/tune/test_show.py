"""What `mjbench tune` prints: the conclusion, what is recommended, lines to paste, notes."""

from dataclasses import replace

import pytest
from tuning_values import apart, blocks, present

from mjbench.commands.tune import show as tuning
from mjbench.commands.tune.result import (
    Accuracy,
    Attempt,
    Effect,
    Limits,
    Recommendation,
    TuneRecord,
    Withdrawal,
    fresh_ratio,
)
from mjbench.commands.tune.settings import Edit, LoopChange, Part, Setting
from mjbench.interval import Interval
from mjbench.results import terminal
from mjbench.status import Status

PRESENT = present()
CLOCK = Setting("timer", "timer off", loop=LoopChange(is_clock_off=True))
JACOBIAN = Setting("jacobian", "jacobian=sparse", (Edit(Part.OPTION, "jacobian", "sparse"),))
ISLAND = Setting("island", "island=disable", (Edit(Part.FLAG, "island", "disable"),))
TIMESTEP = Setting("timestep", "timestep=0.004", (Edit(Part.OPTION, "timestep", "0.004"),))
EXCLUDES = Setting(
    "excludes",
    "exclude 2 pairs",
    (Edit(Part.EXCLUDE, "a", "b"), Edit(Part.EXCLUDE, "a", "c")),
    evidence="2 pairs never touched in 20 s",
)


def recommended(effect, ratio, share, *settings, is_allowed=True):
    accuracy = Accuracy(effect, apart(share), apart(share), [share] * 64)
    interval = Interval(ratio, ratio - 0.01, ratio + 0.01)
    return Recommendation(
        settings, interval, apart(share), (), effect, accuracy, is_allowed=is_allowed
    )


def record(*front, **keywords):
    return TuneRecord(model="robot", present=PRESENT, front=front, stages={}, **keywords)


FREE = recommended(Effect.FREE, 0.8, 0.02, CLOCK, JACOBIAN)
FASTER = recommended(Effect.APPROXIMATE, 0.5, 0.0201, CLOCK, TIMESTEP)
WORSE = recommended(Effect.APPROXIMATE, 0.25, 0.2, TIMESTEP, is_allowed=False)


def test_what_changes_least_comes_first_and_what_is_not_allowed_is_no_advice():
    of_all = record(FREE, FASTER, WORSE)
    assert tuning.conclusion(of_all) == (
        "robot: 1.25 times as fast with the same results: timer off, jacobian=sparse;"
        " 2.00 times as fast without a larger error: timer off, timestep=0.004"
    )
    assert of_all.best() == FASTER
    assert tuning.advised(of_all) == [FREE, FASTER]


@pytest.mark.parametrize(
    ("keywords", "text"),
    [
        ({"allow": Effect.FREE}, "no settings are certainly faster with the same results"),
        ({"allow": Effect.EQUIVALENT}, "faster within the solver's tolerance"),
        ({"limits": Limits(0.03)}, "faster with an error of at most 3 % of the motion"),
        (
            {"limits": Limits(0.01)},
            "an error of at most 1 % of the motion; the present settings have an error of 2 %",
        ),
        (
            {"limits": Limits(0.01, 0.02)},
            "with an error of at most 1 % and a change of at most 2 % of the motion",
        ),
        ({}, "faster without a larger error"),
        ({"status": Status.INTERRUPTED}, "interrupted before"),
        ({"status": Status.FAILED, "detail": "no memory"}, "robot: failed: no memory"),
    ],
)
def test_without_a_recommendation_it_says_what_was_asked_for(keywords, text):
    assert text in tuning.conclusion(record(**keywords))
    assert tuning.advised(record(WORSE, **keywords)) == []


RK4 = Setting("integrator", "integrator=Euler", evidence="one evaluation", saves=0.75)


def test_what_saves_much_by_count_is_named_though_there_was_no_time_for_it():
    of_all = record(untried_halving=[RK4])
    text = "about 4 × as fast (not timed certainly): integrator=Euler"
    assert tuning.conclusion(of_all) == f"robot: {text}"
    assert tuning.conclusion(record(FREE, untried_halving=[RK4])).endswith(
        f"jacobian=sparse; {text}"
    )


def test_lines_to_paste_are_those_of_each_recommendation():
    printed = terminal.text_of(tuning.sections([record(FREE, FASTER)]))
    assert "To apply timer off, jacobian=sparse, in the program:" in printed
    assert '<option jacobian="sparse"/>' in printed
    assert '<option timestep="0.004"/>' in printed
    assert printed.count("    mujoco.mj_resetCallbacks()") == 2
    assert "frame_skip" in printed


def test_flags_and_excludes_are_written_as_mjcf_has_them():
    (snippet,) = tuning.to_apply([JACOBIAN, ISLAND, EXCLUDES])
    option, *excludes = snippet.code.splitlines()
    assert option == '<option jacobian="sparse"><flag island="disable"/></option>'
    assert excludes == [
        "<contact>",
        '  <exclude body1="a" body2="b"/>',
        '  <exclude body1="a" body2="c"/>',
        "</contact>",
    ]
    assert list(tuning.to_apply([])) == []


def tried(knob, label, effect=Effect.FREE, changed_sensors=0, stages=None, **keywords):
    accuracy = Accuracy(effect, None, apart(0.0), [], changed_sensors)
    setting = Setting(knob, label, **keywords)
    ratio = Interval(0.5, 0.49, 0.51)
    return Attempt((setting,), Status.OK, "", accuracy, 0.5, ratio, stages=stages or {})


def test_a_setting_says_what_it_was_measured_to_save():
    of_stages = replace(record(FREE), stages={"constraint solver": 0.6, "kinematics": 0.4})
    solver = tried("solver", "solver=CG", stages={"constraint solver": 0.3, "kinematics": 0.7})
    assert tuning.why(solver, of_stages) == "45 % less in constraint solver, 5 % less in kinematics"
    slower = replace(solver, stages={"constraint solver": 0.1, "kinematics": 0.9})
    assert tuning.why(slower, of_stages) == "55 % less in constraint solver"


def test_a_setting_that_saves_whole_evaluations_is_not_explained_by_a_stage():
    of_stages = replace(record(FREE), stages={"integration": 0.0, "kinematics": 1.0})
    integrator = tried(
        "integrator",
        "integrator=Euler",
        stages={"integration": 0.0, "kinematics": 1.0},
        evidence="one evaluation of the dynamics a step, where RK4 makes four",
        saves=0.75,
    )
    assert tuning.why(integrator, of_stages) == integrator.settings[0].evidence


def test_a_setting_says_what_it_gives_up():
    sensor = tried("sensor", "sensor=disable", loses="sensor data")
    assert "gives up sensor data" in tuning.why(sensor, record())
    visual = tried("visual_geoms", "discardvisual=true", changed_sensors=284)
    assert tuning.changes(visual).startswith("Here, the data of 284 sensors changed. What is drawn")


def test_what_runs_are_too_short_to_show_is_said_where_it_is_offered():
    noslip = Setting("noslip_iterations", "noslip_iterations=0")
    assert "slip over many seconds" in tuning.changes(tried(noslip.knob, noslip.label))
    printed = terminal.text_of(
        tuning.sections([record(recommended(Effect.APPROXIMATE, 0.5, 0.02, noslip))])
    )
    assert "Not shown by simulations this short: with noslip_iterations=0" in printed


def test_a_solver_that_does_not_converge_is_said_first():
    unconverged = replace(record(FREE), present=present(solver_limited=0.98))
    (section,) = tuning.sections([unconverged])
    first, second, *_ = section.conclusions
    assert "does not converge" in first.text and "98 % of the steps" in first.text
    assert second.text.startswith("robot: 1.25 times as fast")
    (section,) = tuning.sections([record(FREE)])
    assert "converge" not in section.conclusions[0].text


def test_without_a_reference_no_error_is_shown():
    unknown = replace(FREE, error=None)
    of_all = replace(record(unknown), present=replace(PRESENT, error=None, solver=None))
    printed = terminal.text_of(tuning.sections([of_all]))
    assert "No reference was run" in printed
    assert next(tuning.rows(of_all))["error"] is None


def test_a_row_of_the_flat_table_has_an_error_as_a_share():
    (row,) = tuning.rows(record(FREE))
    assert (row["settings"], row["error"]) == ("timer off, jacobian=sparse", 0.02)


def timed_alone(label, ratios):
    rows = [blocks(ratio) for ratio in ratios]
    ratio = fresh_ratio(rows)
    setting = Setting(label.partition("=")[0], label)
    return Attempt((setting,), Status.OK, time_ratio=ratio.estimate, ratio=ratio, launches=rows)


def test_what_is_faster_alone_is_certain_among_all_that_were_timed():
    clear = timed_alone("jacobian=sparse", [0.5, 0.51, 0.5, 0.49])
    unsure = timed_alone("solver=CG", [0.97, 0.985, 0.96, 0.985])
    small = timed_alone("island=disable", [0.998, 0.9981, 0.998, 0.9979])
    assert unsure.ratio.high < 1 and small.ratio.high < 1
    assert tuning.faster_alone(record(attempts=[unsure])) == [unsure]
    of_many = [timed_alone(f"iterations={i}", [1.0, 1.01, 1.0, 0.99]) for i in range(17)]
    attempts = [unsure, small, clear, *of_many]
    assert tuning.faster_alone(record(attempts=attempts)) == [clear]
    confirmed = recommended(Effect.FREE, 0.97, 0.0, *unsure.settings)
    assert tuning.faster_alone(record(confirmed, attempts=attempts)) == [clear, unsure]


def test_what_failed_or_was_withdrawn_is_not_faster_alone():
    clear = timed_alone("jacobian=sparse", [0.5, 0.51, 0.5, 0.49])
    failed = replace(clear, status=Status.CRASHED)
    assert tuning.faster_alone(record(attempts=[failed])) == []
    withdrawn = [Withdrawal(clear.settings, "not certainly faster from new starts")]
    assert tuning.faster_alone(record(attempts=[clear], withdrawn=withdrawn)) == []


def test_sensor_data_that_differ_by_more_than_states_are_said():
    equivalent = recommended(Effect.EQUIVALENT, 0.5, 0.02, JACOBIAN)
    sensors = replace(equivalent, accuracy=replace(equivalent.accuracy, sensor_share=0.004))
    text = "within the solver's tolerance (sensor data differ by up to 0.4 %): jacobian=sparse"
    assert text in tuning.conclusion(record(sensors))
    (section,) = tuning.sections([record(sensors)])
    cell = "within tolerance (equivalent); sensor data differ by up to 0.4 %"
    assert cell in section.tables[0].rows[1]
    rounding = replace(equivalent, accuracy=replace(equivalent.accuracy, sensor_share=1e-6))
    for each in (equivalent, rounding):
        assert "sensor data" not in tuning.conclusion(record(each))
