"""`mjbench run` says first what is wrong, or slow, in programs with a planted fault."""

import functools
from collections.abc import Iterator
from pathlib import Path

import program_runs
import pytest
from commands import mjbench

from benchmarks import own_programs
from benchmarks.studies import tally_file
from benchmarks.studies.page_part import of_lines

# The others need OpenGL or JAX, or take longer; `python -m benchmarks.own_programs` runs them all.
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
        assert program.changed_file.is_file() != program.is_wrong


def test_the_page_has_the_committed_results() -> None:
    tally = tally_file.load(own_programs.TALLY, own_programs.ProgramTally, "programs")
    assert own_programs.PART.text() == of_lines(tally.lines())
    assert {each.name for each in tally.programs} == {each.name for each in own_programs.PROGRAMS}
