"""`mjbench falls`: one question, answered by every path."""

import click

from mjbench.cli.context import RunContext
from mjbench.cli.group import cli
from mjbench.cli.shared import JSON, Numbers
from mjbench.errors import InputError


@cli.command()
@click.option("--angles", metavar="RAD,…", help="Initial angles  [default: 0 to 0.4 by 0.05]")
@click.option("--samples", type=click.IntRange(min=1), default=1000, show_default=True)
@click.option("--threads", type=Numbers(), default="1,4,16", show_default=True)
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True)
@JSON
def falls(
    angles: str | None, samples: int, threads: list[int], seed: int, json_file: str | None
) -> None:
    """How likely does the cart-pole fall, by initial angle? One question, answered by every path.

    The pole moves without control from random starts around each angle; it has fallen when it
    passes 0.5 rad within a second. All paths must count the same falls; then their times are
    compared.
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
