"""The group of all commands, and how an error becomes one line and an exit code."""

import contextlib
import os
import sys
from collections.abc import Iterator
from typing import Any, NoReturn

import click

import mjbench
from mjbench.cli import standard_streams
from mjbench.cli.command_help import Command
from mjbench.command_names import LISTED, with_mode
from mjbench.commands.checkup.targets import may_be_target
from mjbench.errors import (
    MachineError,
    MjbenchError,
    describe_unforeseen,
    foreign_module,
    printable,
)
from mjbench.host import platforms
from mjbench.status import ExitCode

_HELP_NAMES = ["-h", "--help"]
# Where a context keeps the words of the command line.
_COMMAND_LINE = "mjbench.command_line"


class CommandGroup(click.Group):
    """A group of commands."""

    command_class = Command

    def add_command(self, cmd: click.Command, name: str | None = None) -> None:
        """Add a command, whose help has both names also where it runs without this group."""
        cmd.context_settings.setdefault("help_option_names", _HELP_NAMES)
        super().add_command(cmd, name)


class Cli(CommandGroup):
    """A group whose errors are one line with the exit code they stand for."""

    group_class = CommandGroup

    def main(self, *arguments: Any, **options: Any) -> Any:
        """Run the command line; what it printed has reached its destination when this ends."""
        with standard_streams.checked(), _errors_reported():
            return super().main(*arguments, **options)

    def make_context(
        self,
        info_name: str | None,
        args: list[str],
        parent: click.Context | None = None,
        **extra: Any,
    ) -> click.Context:
        """Return the context of a command line, which keeps its words (see `command_line`)."""
        typed = tuple(args)
        with _errors_reported():  # it prints the help and the version
            context = super().make_context(info_name, args, parent, **extra)
        context.meta[_COMMAND_LINE] = typed
        return context

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Return a command with its arguments; refuse what cannot run here, but not its help."""
        words = with_mode(args, self.commands)
        if words[0] not in self.commands and may_be_target(words[0]):
            words = ["checkup", *words]
        name, command, rest = super().resolve_command(ctx, words)
        if name is not None and not set(ctx.help_option_names) & set(rest):
            platforms.check_command(name)
        return name, command, rest

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the commands in groups, each in a line."""
        formatter.write_paragraph()
        for heading, lines in LISTED.items():  # without empty lines, to fit on a screen
            formatter.write_heading(heading)
            with formatter.indentation():
                formatter.write_dl([(name.ljust(8), line) for name, line in lines.items()])

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command; report its error in a line, and end with the error's exit code."""
        with _errors_reported():
            _check_folder()
            return super().invoke(ctx)


def command_line() -> tuple[str, ...]:
    """Return the arguments after `mjbench`, as they were typed; none outside of a command."""
    context = click.get_current_context(silent=True)
    arguments: tuple[str, ...] = context.meta.get(_COMMAND_LINE, ()) if context else ()
    return arguments


def option_names() -> set[str]:
    """Return the names of the parameters of the command that runs; none outside of a command."""
    context = click.get_current_context(silent=True)
    return {parameter.name or "" for parameter in context.command.params} if context else set()


def _check_folder() -> None:
    try:
        os.getcwd()  # noqa: PTH109 - Path.cwd() is the same call
    except FileNotFoundError:
        raise MachineError("the current folder no longer exists; change to another one") from None


@contextlib.contextmanager
def _errors_reported() -> Iterator[None]:
    """Report an error in a line, and end with its exit code; usage errors are click's to report."""
    try:
        yield
    except MjbenchError as error:
        report_line(str(error))
        sys.exit(ExitCode.INTERRUPTED if _is_of_interrupt(error) else error.exit_code)
    except (KeyboardInterrupt, click.Abort):
        _end_interrupted()
    except (click.ClickException, click.exceptions.Exit):
        raise
    except BrokenPipeError:  # nobody reads on (`… | head`)
        sys.exit(ExitCode.ENVIRONMENT)
    except SystemExit as error:
        if not (line := foreign_module(error)):
            raise
        report_line(line)
        sys.exit(ExitCode.ENVIRONMENT)
    except Exception as error:
        if _is_of_interrupt(error):  # such as an import of a C extension
            _end_interrupted()
        report_line(describe_unforeseen(error))
        sys.exit(ExitCode.ENVIRONMENT)


def _end_interrupted() -> NoReturn:
    report_line("interrupted")
    sys.exit(ExitCode.INTERRUPTED)


def _is_of_interrupt(error: BaseException | None) -> bool:
    """Return whether an error was raised while KeyboardInterrupt was on its way, or for it."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return error is not None


def report_line(text: str) -> None:
    click.echo(f"mjbench: {printable(text)}", err=True)


@click.group(
    cls=Cli,
    context_settings={"help_option_names": _HELP_NAMES},
    subcommand_metavar="TARGET | COMMAND [ARGS]...",
)
@click.version_option(mjbench.__version__, message="mjbench %(version)s")
def cli() -> None:
    """Measure MuJoCo in Python: your program, ways of stepping, releases.

    A TARGET is a model (.xml, .urdf, .mjb, a shipped model, or PACKAGE:NAME), a Python program, or
    an environment such as Humanoid-v5.

    \b
    Examples:
      mjbench robot.xml                        what can I do?
      mjbench run --seconds 30 train.py        what to change?
      mjbench compare robot.xml --scaling      thread count?
      mjbench versions 3.17.0 4.0.0 robot.xml  4.0.0 slower?
      mjbench ab HEAD WORKTREE bench.py::step  am I slower?
      mjbench show --html report.html          results as HTML

    Exit codes: 0 success; 1 finding; 2 bad input; 3 failure; 130 interrupted.
    """
