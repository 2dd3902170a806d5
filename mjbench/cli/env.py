"""`mjbench env`: where the time of an environment's step goes."""

from typing import Any

import click

from mjbench.cli.context import OutputOptions, measure_and_print
from mjbench.cli.group import cli
from mjbench.cli.shared import (
    LIMIT,
    SEED_NUMBER,
    STORING,
    THREAD_COUNTS,
    THREADS,
    budget,
    count,
    with_options,
)
from mjbench.limits import Bounds

# Steps of an environment that are recorded at most: each holds two states and its controls.
MAX_NSTEP = 100_000


@cli.command()
@click.argument("names", nargs=-1, required=True, metavar="ENVIRONMENT…")
@click.option(
    "--nstep",
    "nstep",
    type=count(Bounds(1, MAX_NSTEP)),
    help="Steps of the environment to record and repeat in every round"
    "  [default: as many as take 0.1 s, from 50 to 1000]",
)
@click.option(
    "--seed",
    type=SEED_NUMBER,
    default=0,
    show_default=True,
    help="Seed of actions and of the first reset; each further episode has the next.",
)
@THREADS
@click.option(
    "--nbatch",
    "nenv",
    type=THREAD_COUNTS,
    help="Numbers of environments in vectorised forms  [default: 1, 2, 4, … usable cores]",
)
@budget(
    10,
    "Time for the rounds of each environment, and as much again for vectorised forms.",
    zero=True,
)
@click.option("--no-vector", is_flag=True, help="Leave out vectorised forms.")
@with_options(LIMIT, STORING)
def env(
    nenv: list[int] | None,
    no_vector: bool,
    output: OutputOptions,
    **options: Any,
) -> None:
    """Where does the time of env.step go, and how fast is the same physics without it?

    ENVIRONMENT is a Gymnasium id, dm_control:DOMAIN-TASK, or MODULE:FACTORY: a function of yours,
    imported from the current folder, that returns an environment. Actions are random. You get the
    shares of physics, observation, reward, controller and wrappers. Nothing is compared before a
    plain loop has repeated the environment's physics, to the last bit.

    \b
    Examples:
      mjbench env Humanoid-v5
      mjbench env dm_control:humanoid-walk --nstep 500
      mjbench env my_env:make --no-vector
    """
    from mjbench.api.env import measurement
    from mjbench.commands.env.result import EnvironmentRecord

    if no_vector and nenv:
        raise click.UsageError("give --nbatch or --no-vector, not both")
    work = measurement(**options, nenv=[] if no_vector else nenv)
    run = measure_and_print(work, output)
    records = run.session.run().of_type(EnvironmentRecord)
    run.exit(status for record in records for status in record.statuses())
