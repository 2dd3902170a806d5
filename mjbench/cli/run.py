"""`mjbench run`: where the time of the user's own program goes."""

import click

from mjbench.cli.context import measure_and_print
from mjbench.cli.group import cli
from mjbench.cli.shared import ProgramCommand, takes
from mjbench.commands.run.options import RunOptions
from mjbench.status import ExitCode


@cli.command(cls=ProgramCommand)
@click.argument("program", nargs=-1, metavar="PROGRAM [ARGS]…", type=click.UNPROCESSED)
@takes(RunOptions)
def run(program: tuple[str, ...], options: RunOptions) -> None:
    """Where does the time of my own program go, and what should I change first?

    PROGRAM is a Python file, or -m and a module, as after `python`. Its arguments follow it;
    options of mjbench come before it. The program runs unchanged, with its own output, and is ended
    after --seconds. The report goes to standard error. `mjbench PROGRAM`, the check-up, prints only
    what to change.

    Exit code: the program's; 2 if MuJoCo refuses its model; 0 if mjbench ended it.

    \b
    Examples:
      mjbench run train.py --num-envs 8
      mjbench run --seconds none -m package.train
    """
    from mjbench.commands.run.driver import exit_code_of, measurement

    context = measure_and_print(measurement(program, options), options, to_stderr=True)
    code = exit_code_of(context.session.run())
    context.exit_with(ExitCode.INTERRUPTED if code is None else code)
