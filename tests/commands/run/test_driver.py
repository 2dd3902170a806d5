"""What `mjbench run` ends with."""

from dataclasses import replace

import pytest
from set_files import run_of

from mjbench.commands.run.driver import exit_code_of
from mjbench.commands.run.launch import UncaughtException
from mjbench.commands.run.result import ProgramRow
from mjbench.status import ExitCode, Status

FAILED = ProgramRow("train.py", Status.OK, "", 1, False, 3.0, 100, 300, [], [])
REFUSED = UncaughtException("ValueError: XML Error: no", None, is_of_model=True)


@pytest.mark.parametrize(
    ("row", "code"),
    [
        (FAILED, 1),
        (replace(FAILED, was_ended=True), ExitCode.OK),
        (replace(FAILED, exception=UncaughtException("ValueError: no", None)), 1),
        (replace(FAILED, exception=REFUSED), ExitCode.USAGE),
    ],
)
def test_the_exit_code_is_the_programs_unless_its_model_is_refused(row, code):
    assert exit_code_of(run_of("run", row)) == code


def test_a_program_that_was_not_measured_has_no_exit_code():
    assert exit_code_of(run_of("run")) is None
