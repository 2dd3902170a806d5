"""`mjbench tune`: which settings make a model faster, and what they cost in accuracy."""

from typing import Any

import click

from mjbench.cli.context import OutputOptions, measure_and_print
from mjbench.cli.group import cli
from mjbench.cli.shared import (
    COUNT,
    LIMIT,
    NAMES,
    SEED,
    STARTS,
    STORING,
    budget,
    models_argument,
    share,
    with_options,
)
from mjbench.simulation.models import ModelSource


@cli.command()
@models_argument("cartpole")
@click.option(
    "--only",
    type=click.Choice(["free", "equivalent", "approximate"]),
    help="Recommend settings with the same results (free), also those within the solver's tolerance"
    " (equivalent), or all (approximate)  [default: approximate]",
)
@click.option(
    "--skip",
    type=NAMES,
    metavar="NAME,…",
    help="Settings to leave alone, by their names in the table of settings, such as"
    " excludes,timestep",
)
@click.option(
    "--max-error",
    type=share(below=10.0),
    help="Largest error to recommend, in percent of how far the model moves, in nine runs of ten:"
    " 1% of a motion of 1 m is 1 cm  [default: the error that your present settings have]",
)
@budget(300, "About how long to search, for each model.")
@click.option(
    "--hold",
    type=COUNT,
    default=8,
    show_default=True,
    help="Steps for which each control is held; timesteps must divide that time",
)
@with_options(SEED, STARTS, LIMIT, STORING)
def tune(
    sources: list[ModelSource],
    limit_s: float,
    output: OutputOptions,
    **options: Any,
) -> None:
    """Which settings make a model faster, and what do they cost in accuracy?

    Tries settings alone and together. Those that change no state come first, then those that change
    no more than rounding does, then those with an error: a distance from the same model at an
    eighth of its timestep. Recommendations are measured again from new starts.
    Without a MODEL: cartpole.

    \b
    Examples:
      mjbench tune humanoid
      mjbench tune robot.xml --only free
      mjbench tune robot.xml --max-error 1% --budget 600s
    """
    from mjbench.api.tune import measurement

    measure_and_print(measurement(sources, **options, limit_s=limit_s), output).exit()
