"""`mjbench tune`: which settings make a model faster, and what they cost in accuracy."""

import contextlib
from pathlib import Path
from typing import Any

import click

from mjbench.cli.context import OutputOptions, measure_and_print
from mjbench.cli.group import cli, report_line
from mjbench.cli.output_file import OutputFile
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
from mjbench.tuning.settings import NBATCH


@cli.command()
@models_argument("cartpole")
@click.option(
    "--engine",
    type=click.Choice(["c", "mjx", "warp"]),
    default="c",
    show_default=True,
    help="Engine that steps the model; errors of MJX and Warp are distances from C",
)
@click.option(
    "--nbatch",
    type=COUNT,
    help=f"Simulations of a batched step of MJX or Warp  [default: {NBATCH}]",
)
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
    "--write",
    "target",
    metavar="FILE",
    help="Write a copy of the MJCF file with the fastest recommended settings; settings of the"
    " program are only printed",
)
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
    target: str | None,
    limit_s: float,
    output: OutputOptions,
    **options: Any,
) -> None:
    """Which settings make a model faster, and what do they cost in accuracy?

    Tries settings alone and together. Those that change no state come first, then those that change
    no more than rounding does, then those with an error: a distance from the same model at an
    eighth of its timestep. Recommendations are measured again from new starts.
    Without a MODEL: cartpole.

    --engine mjx or warp tries settings of that engine: limits of iterations, solver, Jacobian,
    buffers. Times are of a batched step, errors are distances from C.

    \b
    Examples:
      mjbench tune humanoid
      mjbench tune robot.xml --only free --write tuned.xml
      mjbench tune robot.xml --max-error 1% --budget 600s
      mjbench tune robot.xml --engine mjx --nbatch 1024
    """
    from mjbench.api.tune import measurement, write_best

    copy = None if target is None else Path(target)
    work = measurement(sources, **options, limit_s=limit_s, copy=copy)
    with contextlib.closing(OutputFile("--write", target, work.files)) as file:
        file.open()  # fails now, rather than after the search, where it cannot be written
    run = measure_and_print(work, output)
    if copy is not None and not run.is_stopped:
        if write_best(run.session.run(), sources[0], copy, limit_s):
            run.out.print(f"Wrote {target}", soft_wrap=True)
        else:
            reason = "no settings of the file are recommended"
            report_line(f"{target}: not written, because {reason}")
    run.exit()
