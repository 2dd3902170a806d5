"""`mjbench run`: where the time of the user's own program goes."""

from collections.abc import Sequence

import click

from mjbench.cli.command_help import Command
from mjbench.cli.context import measure_and_print
from mjbench.cli.group import cli
from mjbench.cli.shared import takes
from mjbench.commands.run.options import RunOptions
from mjbench.status import ExitCode


class _ProgramCommand(Command):
    """A command whose arguments end with those of a program, as of `python`."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Leave all that follows the program, or `-m` and a module, to the program."""
        return super().parse_args(ctx, self._with_separator(args))

    def _with_separator(self, args: Sequence[str]) -> list[str]:
        flags = {
            name
            for parameter in self.params
            if isinstance(parameter, click.Option) and parameter.is_flag
            for name in parameter.opts
        }
        flags.add("--help")
        i = 0
        while i < len(args) and args[i].startswith("-") and args[i] not in ("-m", "--"):
            i += 1 if args[i] in flags or "=" in args[i] else 2
        return [*args[:i], *([] if args[i : i + 1] == ["--"] else ["--"]), *args[i:]]


@cli.command(cls=_ProgramCommand)
@click.argument("program", nargs=-1, metavar="PROGRAM [ARGS]…", type=click.UNPROCESSED)
@takes(RunOptions)
def run(program: tuple[str, ...], options: RunOptions) -> None:
    """Where does the time of my own program go, and what should I change first?

    PROGRAM is a Python file, or -m and a module, as after `python`. Its arguments follow it;
    options of mjbench come before it. The program runs unchanged, with its own output and exit
    code. The report goes to standard error. `mjbench PROGRAM`, the check-up, runs it for 40 seconds
    at most, and prints only what to change.

    \b
    Examples:
      mjbench run --seconds 30 train.py --num-envs 4
      mjbench run -m package.train
    """
    from mjbench.commands.run.driver import exit_code_of, measurement

    context = measure_and_print(measurement(program, options), options, to_stderr=True)
    code = exit_code_of(context.session.run())
    context.exit_with(ExitCode.INTERRUPTED if code is None else code)
