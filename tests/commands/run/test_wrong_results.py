"""What makes a program's results wrong comes from lint, and from what only a run shows."""

import pytest

from mjbench.commands.lint.check import Finding
from mjbench.commands.run.activities import Place
from mjbench.commands.run.call_times import CallTime, Incident, ProgramCalls
from mjbench.commands.run.hook import call_clock
from mjbench.commands.run.remedies import listing, wrong_results
from mjbench.commands.run.remedies.remedy import RemedyKind


def finding(code, **more):
    return Finding("train.py", 15, 1, code, "do otherwise", None, **more)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        (call_clock.SHARED_DATA, "its own"),
        (call_clock.HALVES, "Runge-Kutta"),
        (call_clock.COPIED_ENVIRONMENT, "begins anew"),
        ("BADQACC", "diverged"),
        ("CONTACTFULL", "memory"),
        ("ANEWONE", "warned"),
    ],
)
def test_what_a_run_shows_to_be_wrong_is_named_at_its_line(name, text):
    incident = Incident(name, Place("train.py", 12, "main"), 3)
    (remedy,) = wrong_results.wrong_results([], ProgramCalls([], [incident]))
    assert remedy.kind == RemedyKind.RESULT
    assert remedy.place.line == 12
    assert text in remedy.text


def test_wrong_results_are_those_of_lint_and_of_the_run_each_once():
    halves = Incident(call_clock.HALVES, Place("train.py", 12, "main"), 1)
    in_turn = Incident(call_clock.IN_TURN, Place("train.py", 12, "main"), 4)
    found = [
        finding("MJB001", is_wrong_result=True),
        finding("MJB008", is_wrong_result=True),
        finding("MJB003"),
    ]
    listed = wrong_results.wrong_results(found, ProgramCalls([], [halves, in_turn]))
    assert [remedy.code for remedy in listed] == ["", "MJB001"]


def test_a_row_of_two_moments_stands_among_the_wrong_results(tmp_path):
    file = tmp_path / "train.py"
    file.write_text(
        "for _ in range(9):\n    mj_step(m, d)\n    log.append((d.time, d.sensordata.copy()))\n"
    )
    (remedy,) = wrong_results.wrong_results(listing.findings_of([str(file)]), ProgramCalls())
    assert (remedy.code, remedy.place.line) == ("MJB015", 3)
    assert "mj_forward(m, d)" in remedy.text


def test_forces_that_nothing_computes_are_wrong_where_they_are_read(tmp_path):
    file = tmp_path / "train.py"
    file.write_text("x = data.qpos\ny = data.cfrc_ext[1]\nz = data.cfrc_ext[2]\n")
    files = [str(file)]
    (remedy,) = wrong_results.wrong_results([], ProgramCalls(), files, computes_forces=False)
    assert remedy.place.line == 2
    assert "mj_rnePostConstraint" in remedy.text
    assert wrong_results.wrong_results([], ProgramCalls(), files, computes_forces=True) == []
    place = Place("train.py", 15, "main")
    call = CallTime("mj_rnePostConstraint", 1, 1, place, None, 9, 0.1, 0, 1, 0, 0)
    called = ProgramCalls([call])
    assert wrong_results.wrong_results([], called, files, computes_forces=False) == []
