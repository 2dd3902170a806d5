"""What `mjbench run` measures: where the time of the user's program goes."""

import sys
from collections.abc import Sequence
from pathlib import Path

from mjbench.commands.run import launch, measure
from mjbench.commands.run.launch import Program
from mjbench.commands.run.options import RunOptions
from mjbench.commands.run.result import ProgramRow
from mjbench.errors import InputError
from mjbench.options import stored
from mjbench.results.runs import Record, Run
from mjbench.session import Item, Items, Measurement, Observer
from mjbench.status import ExitCode


def measurement(program: Sequence[str], options: RunOptions) -> Measurement:
    """Return the measurement of a program with its arguments."""
    if not program:
        raise InputError("give a program to run")
    to_run = Program(program, options.python or sys.executable)
    launch.check(to_run)

    def items(earlier: Sequence[Record], observer: Observer) -> Items:
        seen = measure.observed(to_run, options.seconds, options.rate_hz)
        yield Item([measure.record(to_run.name, seen)])

    arguments = {"program": program, **stored(options)}
    files = [Path(program[0])] if Path(program[0]).is_file() else []
    return Measurement("run", arguments, files, items)


def exit_code_of(run: Run) -> int | None:
    """Return that of the program, of a fault of its model, or 0 where mjbench ended it.

    None where it was not measured.
    """
    for row in run.of_type(ProgramRow):
        if row.was_ended:
            return ExitCode.OK
        is_of_model = row.exception is not None and row.exception.is_of_model
        return ExitCode.USAGE if is_of_model else row.exit_code
    return None
