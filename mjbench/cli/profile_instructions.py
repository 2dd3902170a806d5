"""`mjbench profile --instructions`: instructions per step, counted by Callgrind."""

from typing import Any

import click

from mjbench.cli.context import OutputOptions, measure_and_print
from mjbench.cli.group import cli
from mjbench.cli.shared import COUNT, COUNTS_OUTPUT, SIZES, models_argument, seconds, with_options


@cli.command("profile --instructions")
@models_argument()
@click.option(
    "--release",
    "releases",
    multiple=True,
    metavar="RELEASE",
    help="Release to count in; may be given several times.  [default: installed]",
)
@click.option("--top", type=COUNT, default=15, show_default=True, help="List this many functions.")
@click.option(
    "--time-limit",
    "limit_s",
    type=seconds(),
    default="600s",
    show_default=True,
    help="Kill a release's process that finishes no model for this long.",
)
@with_options(SIZES, COUNTS_OUTPUT)
def profile_instructions(top: int, output: OutputOptions, **options: Any) -> None:
    """Count instructions per step, by function and stage; within 0.1 % the same on a busy machine.

    Needs valgrind. The first RELEASE draws start states and controls; every other one does the same
    work. Without a MODEL: all shipped models.

    \b
    Example:
      mjbench profile --instructions humanoid --release 3.3.0 --release 4.0.0
    """
    from mjbench.api.profile import of_instructions
    from mjbench.counts.records import InstructionsRecord
    from mjbench.report import counts

    measure_and_print(
        of_instructions(**options),
        output,
        summary=lambda run: counts.sections(run.of_type(InstructionsRecord), top),
    ).exit()
