"""The group of all commands, and how an error becomes one line and an exit code."""

import sys
import tempfile
import traceback
from typing import Any

import click

import mjbench
from mjbench.errors import MjbenchError, one_line
from mjbench.status import ExitCode


class Cli(click.Group):
    """A group whose errors are one line with the exit code they stand for."""

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command; report its error in a line, and end with the error's exit code."""
        try:
            return super().invoke(ctx)
        except MjbenchError as error:
            click.echo(f"mjbench: {error}", err=True)
            sys.exit(error.exit_code)
        except (KeyboardInterrupt, click.Abort):
            click.echo("mjbench: interrupted", err=True)
            sys.exit(ExitCode.INTERRUPTED)
        except (click.ClickException, click.exceptions.Exit):
            raise  # usage errors and --help, which click reports
        except Exception as error:
            click.echo(f"mjbench: unexpected {describe_unexpected(error)}", err=True)
            sys.exit(ExitCode.ENVIRONMENT)


def describe_unexpected(error: Exception) -> str:
    """Return an unforeseen error in one line, and write its traceback to a file that it names."""
    line = f"{type(error).__name__}: {one_line(error)}" if str(error) else type(error).__name__
    try:
        with tempfile.NamedTemporaryFile(
            "w", prefix="mjbench-error-", suffix=".txt", delete=False, encoding="utf-8"
        ) as file:
            file.write("".join(traceback.format_exception(error)))
    except (OSError, ValueError):  # no folder for it, or text that is not Unicode
        return line
    return f"{line}; please report it with the details in {file.name}"


@click.group(cls=Cli, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(mjbench.__version__, message="mjbench %(version)s")
def cli() -> None:
    """Measure MuJoCo in Python: ways of stepping, your loop, releases.

    \b
    Examples:
      mjbench compare robot.xml              which way of stepping is fastest; do all agree?
      mjbench compare humanoid --threads 1,2,4 --nbatch 256
      mjbench profile robot.xml              where does a step's time go?
      mjbench lint train.py                  what makes my loop slow, or its log wrong?
      mjbench versions 3.17.0 4.0.0 robot.xml    is the new release slower?
      mjbench explain 3.17.0 4.0.0 pile      which functions account for it?
      mjbench selfcheck                      how often is a verdict wrong here?
      mjbench models                         the shipped models

    MODEL is one of the shipped models, a path to .xml or .mjb, or PACKAGE:NAME for a model inside
    an installed package, such as gymnasium:ant or dm_control:humanoid.

    Exit codes: 0 nothing found, 1 a finding (paths disagree), 2 bad usage or input, 3 the
    environment failed (crash, time limit, disk), 130 interrupted.
    """
