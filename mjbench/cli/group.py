"""The group of all commands, and how an error becomes one line and an exit code."""

import contextlib
import importlib
import os
import sys
from collections import UserDict
from collections.abc import Iterator, Sequence
from typing import Any, NoReturn

import click

import mjbench
from mjbench.cli import standard_streams
from mjbench.cli.command_help import Command
from mjbench.command_names import LISTED, NAMES, module_of, with_mode
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


class _Commands(UserDict[str, click.Command]):
    """The commands by name; the module of one is imported when it is looked up."""

    def __missing__(self, name: str) -> click.Command:
        if name not in self:
            raise KeyError(name)
        importlib.import_module(f"mjbench.cli.{module_of(name)}")  # adds it to the group
        return self.data[name]

    def __contains__(self, name: object) -> bool:
        return name in NAMES

    def __iter__(self) -> Iterator[str]:
        return iter(NAMES)

    def __len__(self) -> int:
        return len(NAMES)


class CommandGroup(click.Group):
    """A group of commands."""

    command_class = Command

    def add_command(self, cmd: click.Command, name: str | None = None) -> None:
        """Add a command, whose help ends with how its times and percentages are written.

        It has both names of help also where it runs without this group.
        """
        sentences = dict.fromkeys(getattr(each.type, "syntax", "") for each in cmd.params)
        cmd.epilog = " ".join(filter(None, sentences))
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

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        return super().parse_args(ctx, self.with_command(args))

    def with_command(self, words: list[str]) -> list[str]:
        """Return a command line with the command that `help`, or an option first, stands for."""
        names = {name for parameter in self.params for name in parameter.opts}
        match words:
            case ["help", *named]:
                return self._help(named)
            case [first, _, *_] if first.startswith("-") and first not in {*names, *_HELP_NAMES}:
                return ["checkup", *words]
        return words

    def _help(self, words: Sequence[str]) -> list[str]:
        """Return the command line that prints the help of what the words name."""
        if not words or words[0] in {"help", *_HELP_NAMES}:
            return ["--help"]
        name, *rest = words
        if _is_target(name):
            return ["checkup", "--help"]
        if isinstance(self.commands.get(name), click.Group):
            return [*words, "--help"]
        return [name, "--help", *rest]  # before what would be a program's

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Return a command with its arguments; refuse what cannot run here, but not its help."""
        words = with_mode(args, self.commands)
        if _is_target(words[0]):
            words = ["checkup", *words]
        name, command, rest = super().resolve_command(ctx, words)
        if name is not None and not set(ctx.help_option_names) & set(rest):
            platforms.check_command(name)
        return name, command, rest

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the commands in groups, each in a line; the text has the two options."""
        formatter.write_paragraph()
        for heading, commands in LISTED.items():  # without empty lines, to fit on a screen
            formatter.write(f"{heading}:\n")
            for name, command in commands.items():
                formatter.write(f"  {name:8}  {command.does:40} {command.takes:>7}".rstrip() + "\n")

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command; report its error in a line, and end with the error's exit code."""
        with _errors_reported():
            _check_folder()
            return super().invoke(ctx)


def _is_target(word: str) -> bool:
    """Return whether a word is no command, and may name what to check."""
    from mjbench.commands.checkup.targets import may_be_target

    return word not in NAMES and may_be_target(word)


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


_MORE = """
A TARGET is a model (.xml, .urdf, .mjb, or a shipped one), a program (.py, which
is run) with its arguments, or an environment such as Humanoid-v5.

\b
Examples:
  mjbench robot.xml                        # what makes this model faster?
  mjbench train.py --num-envs 8            # what should this program change?
  mjbench compare robot.xml --scaling      # which number of threads is best?
  mjbench versions 3.17.0 4.0.0 robot.xml  # is 4.0.0 slower than 3.17.0?
  mjbench ab HEAD WORKTREE bench.py::step  # is my worktree slower than HEAD?
  mjbench show --html report.html          # the last results as a page

\b
Exit codes: 0 ok; 1 finding; 2 bad input; 3 failed or undecided; 130 Ctrl-C.
`mjbench help COMMAND` shows its options, `mjbench --version` the version.
"""


@click.group(
    cls=Cli,
    commands=_Commands(),
    context_settings={"help_option_names": _HELP_NAMES},
    subcommand_metavar="TARGET | COMMAND [ARGS]…",
    epilog=_MORE,
)
@click.version_option(mjbench.__version__, message="mjbench %(version)s")
def cli() -> None:
    """Measure how fast MuJoCo steps in Python, and find what makes it slow."""
