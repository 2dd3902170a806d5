"""The notes of a search for settings: what figures rest on, and what was left out."""

from dataclasses import replace

from tuning_values import present

from mjbench.commands.tune import notes as tuning_notes
from mjbench.commands.tune.result import Attempt, TuneRecord, Withdrawal
from mjbench.commands.tune.settings import option
from mjbench.status import Status

PRESENT = present()
JACOBIAN, TIMESTEP = option("jacobian", "sparse"), option("timestep", "0.004")


def test_notes_say_what_figures_rest_on_and_what_was_left_out():
    of_all = TuneRecord(
        model="robot",
        present=PRESENT,
        withdrawn=[Withdrawal((TIMESTEP,), "diverges in 3 of 64 simulations")],
        attempts=[Attempt((JACOBIAN,), Status.CRASHED, "killed by SIGSEGV")],
        no_reference="crashed",
        no_second_look="it takes about 12 s, and 3 s were left",
        untried=2,
        untried_combinations=1,
    )
    notes = "\n".join(tuning_notes.notes(of_all))
    assert "over 0.5 s of 64 simulations" in notes
    assert "Withdrawn by the second look: timestep=0.004: diverges in 3 of 64 simulations" in notes
    assert "Failed: jacobian=sparse: killed by SIGSEGV" in notes
    assert "no time for 2 settings and 1 combination: give a longer --budget" in notes
    assert "Not run again from new starts: it takes about 12 s" in notes
    assert "no reference from new starts, so errors are those of the search: crashed" in notes
    never = "\n".join(tuning_notes.left_out(replace(of_all, present=replace(PRESENT, error=None))))
    assert (
        "There is no reference from which to measure errors, so settings that change the motion"
        " are not recommended: crashed"
    ) in never
    parted = replace(of_all, present=replace(PRESENT, is_comparable=False))
    assert "part too soon" in "\n".join(tuning_notes.notes(parted))


def test_a_stage_that_no_setting_shortens_is_a_note():
    of_all = TuneRecord(model="robot", present=PRESENT, stages={"collision": 0.7})
    line = "70 % of a step is collision: simpler or fewer geoms would help most"
    assert line in tuning_notes.notes(of_all)


def test_shares_are_in_percent_however_small_they_are():
    assert tuning_notes.percent(0.0123) == "1.2 %"
    assert tuning_notes.percent(2e-9) == "2e-07 %"
