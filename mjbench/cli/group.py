"""The group of all commands."""

import sys
from typing import Any

import click

import mjbench
from mjbench.cli.shared import INTERRUPTED
from mjbench.errors import MjbenchError


class Cli(click.Group):
    """A group whose errors are one line with the exit code they stand for."""

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command; end with the exit code of its error, told in a line."""
        try:
            return super().invoke(ctx)
        except MjbenchError as error:
            click.echo(f"mjbench: {error}", err=True)
            sys.exit(error.exit_code)
        except (KeyboardInterrupt, click.Abort):
            click.echo("mjbench: interrupted", err=True)
            sys.exit(INTERRUPTED)


@click.group(cls=Cli, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(mjbench.__version__, message="mjbench %(version)s")
def cli() -> None:
    """Which way of stepping MuJoCo from Python is fastest, for your model on your machine?

    \b
    Examples:
      mjbench compare                        every path on our ten models
      mjbench compare cartpole humanoid      two of them
      mjbench compare robot.xml --threads 1,2,4 --nbatch 256
      mjbench compare gymnasium:ant --hold 5 --paths python_loop_hold,batch_step
      mjbench models                         what there is to run
      mjbench paths                          what can be compared here
      mjbench releases                       which MuJoCo releases exist, here and elsewhere

    MODEL is one of ours (`mjbench models`), a path to .xml or .mjb, or PACKAGE:NAME for a model
    inside an installed package, such as gymnasium:ant or dm_control:humanoid.

    Exit codes: 0 fine, 1 a finding (paths disagree), 2 bad usage or input, 3 the environment
    failed (crash, time limit, disk), 130 interrupted.
    """
