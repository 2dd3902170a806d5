"""`mjbench run` says first what is wrong, or slow, in programs with a planted fault."""

import dataclasses
import functools
from collections.abc import Iterator
from pathlib import Path

import program_runs
import pytest
from commands import mjbench

from benchmarks.studies import own_programs, tally_file
from benchmarks.studies.page_part import of_lines

# The others need OpenGL or JAX, or take longer.
# `python -m benchmarks.studies.own_programs` runs them all.
QUICK = (
    "forward_after_step",
    "planner_copies",
    "stored_views",
    "halves_of_rk4",
    "diverged",
    "unfilled_forces",
)


@pytest.fixture(scope="module", autouse=True)
def brief() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        program_runs.measure_briefly(patch)
        yield


@pytest.mark.parametrize("name", QUICK)
def test_the_first_advice_is_the_right_one(name: str, tmp_path: Path) -> None:
    program = next(each for each in own_programs.PROGRAMS if each.name == name)
    said = own_programs.advice(program, 60, functools.partial(mjbench, cwd=tmp_path))
    assert said.is_right(program), said


def test_every_program_whose_fault_costs_time_has_its_change() -> None:
    for program in own_programs.PROGRAMS:
        assert program.file.is_file()
        assert program.changed_file.is_file() == program.has_change


def test_the_page_has_the_committed_results() -> None:
    tally = tally_file.load(own_programs.TALLY, own_programs.ProgramTally, "programs")
    assert own_programs.PART.text() == of_lines(tally.lines())
    assert {each.name for each in tally.programs} == {each.name for each in own_programs.PROGRAMS}


@pytest.mark.parametrize(
    ("predicted_error", "measured_error", "is_near"),
    [(0.0, 0.0, False), (0.05, 0.0, True), (0.0, 0.06, False)],
)
def test_a_prediction_is_near_within_five_points_or_its_own_interval(
    monkeypatch: pytest.MonkeyPatch, predicted_error: float, measured_error: float, is_near: bool
) -> None:
    program = own_programs.PROGRAMS[0]
    said = own_programs.Advice(program.line, program.says, 0.70, predicted_error)
    share = own_programs.MeasuredShare(0.605, measured_error)
    monkeypatch.setattr(own_programs, "advice", lambda *_: said)
    monkeypatch.setattr(own_programs, "measured", lambda *_: share)
    result = own_programs.ProgramResult.of(program, 60, 9)
    assert result.is_near == is_near
    assert ("–" in result.shares.split("|")[-1]) == (measured_error > 0)


def test_the_uncertainty_of_a_measured_share_is_of_the_median_of_its_rounds(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    seconds = iter([1.0, 0.6, 0.7, 1.0, 1.0, 0.5])  # the second round begins with the change
    monkeypatch.setattr(own_programs, "_loop_s", lambda *_: next(seconds))
    share = own_programs.measured(own_programs.PROGRAMS[0], 60, 3)
    assert share.median == pytest.approx(0.6)
    assert share.error == pytest.approx(1.2533 * 0.1 / 3**0.5, rel=1e-3)


def test_a_program_that_is_measured_again_replaces_its_row_alone() -> None:
    tally = tally_file.load(own_programs.TALLY, own_programs.ProgramTally, "programs")
    first, *others = tally.programs
    again = dataclasses.replace(first, measured=0.9)
    assert tally.with_result(again).programs == [again, *others]
    without = dataclasses.replace(tally, programs=others)
    assert without.with_result(again).programs == [again, *others]
