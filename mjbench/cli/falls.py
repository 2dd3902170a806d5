"""`mjbench falls`: an example, one question that several paths answer."""

import click

from mjbench.cli.context import RunContext
from mjbench.cli.group import cli
from mjbench.cli.shared import COUNT, JSON, SEED_NUMBER, Angles, Numbers
from mjbench.instrument.limits import MAX_THREADS


@cli.command()
@click.option("--angles", type=Angles(), help="Initial angles  [default: 0 to 0.4 by 0.05]")
@click.option(
    "--samples",
    type=COUNT,
    default=1000,
    show_default=True,
    help="Random starts for each angle.",
)
@click.option(
    "--threads",
    type=Numbers(MAX_THREADS),
    default="1,4,16",
    show_default=True,
    help="Thread counts for each path that has threads.",
)
@click.option("--seed", type=SEED_NUMBER, default=0, show_default=True, help="Seed of the starts.")
@JSON
def falls(
    angles: tuple[float, ...] | None,
    samples: int,
    threads: list[int],
    seed: int,
    json_file: str | None,
) -> None:
    """An example: how likely does the cart-pole fall, by initial angle, as several paths count it?

    The pole moves without control from random starts around each angle; it has fallen when it
    passes 0.5 rad within a second. The Python loop, mujoco.rollout and mujoco.batch must all count
    the same falls; only then are their times compared.

    \b
    Example:
      mjbench falls --angles 0,0.1,0.2
    """
    from mjbench.instrument.machine import usable_cores
    from mjbench.loop import pole_example
    from mjbench.report.documents import FallsDocument
    from mjbench.report.pole_example import print_falls

    with RunContext("falls", json_file) as run:
        experiment = pole_example.measure(angles or pole_example.ANGLES_RAD, samples, threads, seed)
        print_falls(run.out, experiment, usable_cores())
        run.write(FallsDocument.of(experiment))
