"""`mjbench falls`: an example, one question that several paths answer."""

import click

from mjbench.cli.context import RunContext
from mjbench.cli.group import cli
from mjbench.cli.shared import JSON, Numbers
from mjbench.errors import InputError


@cli.command()
@click.option("--angles", metavar="RAD,…", help="Initial angles  [default: 0 to 0.4 by 0.05]")
@click.option(
    "--samples",
    type=click.IntRange(min=1),
    default=1000,
    show_default=True,
    help="Random starts for each angle.",
)
@click.option(
    "--threads",
    type=Numbers(),
    default="1,4,16",
    show_default=True,
    help="Thread counts for each path that has threads.",
)
@click.option(
    "--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Seed of the starts."
)
@JSON
def falls(
    angles: str | None, samples: int, threads: list[int], seed: int, json_file: str | None
) -> None:
    """An example: how likely does the cart-pole fall, by initial angle, as several paths count it?

    The pole moves without control from random starts around each angle; it has fallen when it
    passes 0.5 rad within a second. The Python loop, mujoco.rollout and mujoco.batch must all count
    the same falls; only then are their times compared.
    """
    from mjbench.instrument.machine import usable_cores
    from mjbench.loop import pole_example
    from mjbench.report.documents import FallsDocument
    from mjbench.report.pole_example import print_falls

    try:
        angles_rad = (
            tuple(float(word) for word in angles.split(",")) if angles else pole_example.ANGLES_RAD
        )
    except ValueError as error:
        raise InputError(f"--angles {angles}: {error}") from error
    with RunContext("falls", json_file) as run:
        experiment = pole_example.measure(angles_rad, samples, threads, seed)
        print_falls(run.out, experiment, usable_cores())
        run.write(FallsDocument.of(experiment))
