"""`mjbench latency`: how long single steps take, and which are late."""

from typing import Any

import click

from mjbench.cli.context import OutputOptions, measure_and_print
from mjbench.cli.group import cli
from mjbench.cli.shared import (
    COUNT,
    HERTZ,
    HOLD,
    LIMIT,
    SEED,
    STARTS,
    STORING,
    budget,
    models_argument,
    seconds,
    with_options,
)


@cli.command()
@models_argument("cartpole")
@click.option(
    "--deadline",
    "deadline_s",
    type=seconds(),
    help="Time by which a step should end  [default: the time between two paced steps;"
    " free-running, the model's timestep]",
)
@click.option("--rate", "rate_hz", type=HERTZ, help="Paced steps per second  [default: real time]")
@click.option(
    "--nstep", type=COUNT, help="Steps at each pace  [default: 10,000, or what the budget allows]"
)
@budget(10, "Time for the steps of each pace, if there are more than 1,000.")
@with_options(HOLD, SEED, STARTS, LIMIT, STORING)
def latency(output: OutputOptions, **options: Any) -> None:
    """How long do single steps take, which miss their deadline, and what do slow ones share?

    Steps are measured free-running, each after the other, and paced: due at a fixed rate, as in a
    controller. Without a MODEL: cartpole.

    \b
    Examples:
      mjbench latency humanoid
      mjbench latency robot.xml --rate 1000 --deadline 500us
    """
    from mjbench.api.latency import measurement

    measure_and_print(measurement(**options), output).exit()
