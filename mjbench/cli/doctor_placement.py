"""`mjbench doctor --placement`: how far a step's time depends on where the code lies."""

from typing import Any

import click

from mjbench.cli.context import OutputOptions, measure_and_print
from mjbench.cli.group import cli
from mjbench.cli.shared import (
    COUNT,
    SIZES_OF_STARTS,
    STORING,
    budget,
    models_argument,
    with_options,
)


@cli.command("doctor --placement")
@models_argument("cartpole", "humanoid")
@click.option(
    "--release",
    "release_name",
    default="installed",
    show_default=True,
    metavar="RELEASE",
    help="A version such as 3.5.0, a wheel, a folder of wheels, or `installed`.",
)
@click.option(
    "--launches",
    type=COUNT,
    default=14,
    show_default=True,
    help="Launches for each of the four placements; an interval needs at least 9.",
)
@budget(
    180,
    "Time for each model, once it is loaded; after it, no launch begins.",
    is_renamed=True,
)
@with_options(SIZES_OF_STARTS, STORING)
def doctor_placement(time_limit: float, output: OutputOptions, **options: Any) -> None:
    """How far does the time of a step depend on where MuJoCo's machine code lies in memory?

    Compares a release as shipped with the same release moved by 0, 16, 32 and 48 bytes within a
    cache line. A benchmark of one build cannot tell smaller differences than these from a change of
    the code. Without a MODEL: cartpole and humanoid.

    \b
    Examples:
      mjbench doctor --placement robot.xml
      mjbench doctor --placement cloth pile --release 3.3.1
    """
    from mjbench.api.doctor import placements

    measure_and_print(placements(**options, budget_s=time_limit), output, at_end=True).exit()
