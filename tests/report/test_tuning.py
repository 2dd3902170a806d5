"""What `mjbench tune` prints: the conclusion, what is recommended, lines to paste, notes."""

from dataclasses import replace

import pytest
from tuning_values import NOTHING, apart, present

from mjbench.measuring.ratio import Ratio
from mjbench.pages import terminal
from mjbench.report import tuning
from mjbench.status import Status
from mjbench.tuning.mesh_notes import MeshNote, Primitive
from mjbench.tuning.records import (
    Accuracy,
    Attempt,
    Effect,
    Recommendation,
    TuneRecord,
    Withdrawal,
)
from mjbench.tuning.settings import Edit, LoopChange, Part, Setting

PRESENT = present()
CLOCK = Setting("engine clock", "engine clock off", loop=LoopChange(is_clock_off=True))
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
    accuracy = Accuracy(effect, apart(share), apart(share), NOTHING, [share] * 64)
    interval = Ratio(ratio, ratio - 0.01, ratio + 0.01)
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
        "robot: 1.25 times as fast with the same results: engine clock off, jacobian=sparse;"
        " 2.00 times as fast without a larger error: engine clock off, timestep=0.004"
    )
    assert of_all.best() == FASTER
    assert tuning.advised(of_all) == [FREE, FASTER]


@pytest.mark.parametrize(
    ("keywords", "text"),
    [
        ({"only": Effect.FREE}, "no settings are certainly faster with the same results"),
        ({"only": Effect.EQUIVALENT}, "faster within the solver's tolerance"),
        ({"max_error": 0.01}, "faster with an error of at most 1 % of the motion"),
        ({}, "faster without a larger error"),
        ({"status": Status.INTERRUPTED}, "interrupted before"),
        ({"status": Status.FAILED, "detail": "no memory"}, "robot: failed: no memory"),
    ],
)
def test_without_a_recommendation_it_says_what_was_asked_for(keywords, text):
    assert text in tuning.conclusion(record(**keywords))
    assert tuning.advised(record(WORSE, **keywords)) == []


def test_lines_to_paste_are_those_of_each_recommendation():
    printed = terminal.text_of(tuning.sections([record(FREE, FASTER)]))
    assert "To apply engine clock off, jacobian=sparse, in the program:" in printed
    assert '<option jacobian="sparse"/>' in printed
    assert '<option timestep="0.004"/>' in printed
    assert printed.count("    mujoco.mj_resetCallbacks()") == 2
    assert "frame_skip" in printed


def test_flags_and_excludes_are_written_as_mjcf_has_them():
    (snippet,) = tuning.to_apply([JACOBIAN, ISLAND, EXCLUDES])
    option, excludes = snippet.code.splitlines()
    assert option == '<option jacobian="sparse"><flag island="disable"/></option>'
    assert "2 <exclude" in excludes
    assert list(tuning.to_apply([])) == []


def test_notes_say_what_figures_rest_on_and_what_was_left_out():
    of_all = record(
        FREE,
        withdrawn=[Withdrawal([TIMESTEP], "diverges in 3 of 64 runs")],
        attempts=[Attempt([JACOBIAN], Status.CRASHED, "killed by SIGSEGV")],
        untried=4,
        meshes=[MeshNote("arm", "arm_mesh", Primitive.BOX, 0.97)],
    )
    notes = "\n".join(tuning.notes(of_all))
    assert "over 0.5 s of 64 runs" in notes
    assert "Withdrawn by the second look: timestep=0.004: diverges in 3 of 64 runs" in notes
    assert "Failed: jacobian=sparse: killed by SIGSEGV" in notes
    assert "no time for 4" in notes
    assert "fills 97 % of a box" in notes
    parted = replace(of_all, present=replace(PRESENT, is_comparable=False))
    assert "part too soon" in "\n".join(tuning.notes(parted))


def test_a_setting_says_why_it_can_help():
    stages = {"constraint solver": 0.4, "constraint making": 0.1, "constraint projection": 0.0}
    of_stages = replace(record(FREE), stages=stages)
    assert "50 % of a step" in tuning.why(Setting("solver", "solver=CG"), of_stages)
    assert "2 pairs never touched" in tuning.why(EXCLUDES, of_stages)
    assert "gives up sensor data" in tuning.why(
        Setting("sensor", "sensor=disable", loses="sensor data"), of_stages
    )


def test_errors_have_units_and_a_share():
    assert tuning.percent(0.0123) == "1.2 %"
    assert tuning.percent(2e-9) == "2e-07 %"
    (row,) = tuning.rows(record(FREE))
    assert (row.settings, row.error) == ("engine clock off, jacobian=sparse", 0.02)
