"""`mjbench run`: where the time of the user's own program goes."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from mjbench.cli.context import OutputOptions, measure_and_print
from mjbench.cli.group import cli
from mjbench.cli.shared import COUNT, OUTPUT, RenamedOption, count, seconds
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
    "--attach",
    "pid",
    type=COUNT,
    metavar="PID",
    help="Sample a running program for --seconds (10s by default). It keeps running.",
)
@click.option(
    "--sample-rate",
    "--rate",
    "rate_hz",
    cls=RenamedOption,
    type=count(SAMPLES_PER_S),
    help="Samples of the program's stacks per second  [default: 100; 20 of a program with several"
    " child processes; 10 with --native, or fewer where they would cost too much]",
)
@click.option(
    "--native",
    "has_native",
    is_flag=True,
    help="Also read the stacks of libraries, to tell NumPy and PyTorch from Python. Each sample"
    " then stops the program for some milliseconds.",
)
@click.option(
    "--python",
    "interpreter",
    metavar="FILE",
    help="Python interpreter that runs the program  [default: the one that runs mjbench]",
)
@click.option(
    "-o",
    "--output",
    "flame_graph",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    help="Also write the samples as a flame graph (FILE.svg), or as a profile for"
    " https://www.speedscope.app (FILE.json).",
)
@click.option(
    "--confirm",
    "is_confirmed",
    is_flag=True,
    help="Measure the savings from changes that mjbench can make itself: run the program 8 times"
    " with and 8 times without each.",
)
@OUTPUT
def run(flame_graph: Path | None, output: OutputOptions, **options: Any) -> None:
    """Where does the time of my own program go, and what should I change first?

    PROGRAM is a Python file, or -m and a module, as after `python`. Its arguments follow it;
    options of mjbench come before it. The program runs unchanged, with its own output and exit
    code. The report goes to standard error. `mjbench PROGRAM`, the check-up, runs it for 40 seconds
    at most, and prints only what to change.

    \b
    Examples:
      mjbench run --seconds 30 train.py --num-envs 4
      mjbench run -m package.train
      mjbench run --confirm --seconds 30 train.py
      mjbench run --output flame.svg train.py
      mjbench run --attach 4242
    """
    from mjbench.api.run import exit_code_of, measurement
    from mjbench.report import flame

    if flame_graph is not None:
        flame.check(flame_graph)
    if output.json_file == "-":
        raise InputError("--json -: standard output is the program's own; name a file")
    work = measurement(**options, flame_graph=flame_graph)
    context = measure_and_print(work, output, to_stderr=True)
    code = exit_code_of(context.session.run())
    context.exit_with(ExitCode.INTERRUPTED if code is None else code)
