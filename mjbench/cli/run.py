"""`mjbench run`: where the time of the user's own program goes."""

from collections.abc import Sequence
from typing import Any

import click

from mjbench.cli.context import OutputOptions, measure_and_print
from mjbench.cli.group import cli
from mjbench.cli.shared import OUTPUT, count, seconds
from mjbench.errors import InputError
from mjbench.limits import SAMPLES_PER_S
from mjbench.status import ExitCode


class _ProgramCommand(click.Command):
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
@click.option(
    "--seconds",
    "--budget",
    "seconds",
    type=seconds(),
    help="End the program, as Ctrl-C would, when it has stepped for this long; with MJX alone, this"
    " counts from its first compiled function  [default: run it to its end]",
)
@click.option(
    "--sample-rate",
    "rate_hz",
    type=count(SAMPLES_PER_S),
    help="Samples of the program's stacks per second  [default: 100; 20 of a program with several"
    " child processes]",
)
@click.option(
    "--python",
    "interpreter",
    metavar="FILE",
    help="Python interpreter that runs the program  [default: the one that runs mjbench]",
)
@OUTPUT
def run(output: OutputOptions, **options: Any) -> None:
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
    from mjbench.api.run import exit_code_of, measurement

    if output.json_file == "-":
        raise InputError("--json -: standard output is the program's own; name a file")
    work = measurement(**options)
    context = measure_and_print(work, output, to_stderr=True)
    code = exit_code_of(context.session.run())
    context.exit_with(ExitCode.INTERRUPTED if code is None else code)
