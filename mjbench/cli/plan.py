"""`mjbench plan`: plans per second of a sampling planner, by the path that rolls out."""

from typing import Any

import click

from mjbench.cli.context import OutputOptions, measure_and_print
from mjbench.cli.group import cli
from mjbench.cli.shared import (
    COUNT,
    LIMIT,
    NAMES,
    PLANNING_STARTS,
    SEED,
    STORING,
    THREADS,
    RenamedOption,
    budget,
    models_argument,
    numbers,
    own_path_folder,
    seconds,
    with_options,
)


@cli.command()
@models_argument("cartpole")
@click.option(
    "--algorithm",
    type=click.Choice(("predictive-sampling", "mppi", "cem")),
    default="mppi",
    show_default=True,
    help="How the plan improves.",
)
@click.option(
    "--nbatch",
    "--samples",
    "samples",
    cls=RenamedOption,
    type=numbers(),
    default="64",
    show_default=True,
    help="Candidates of a plan; several numbers are tried one after the other.",
)
@click.option(
    "--knots",
    type=numbers(),
    default="25",
    show_default=True,
    help="Controls of a candidate; several numbers are tried likewise.",
)
@click.option(
    "--hold", type=COUNT, default=20, show_default=True, help="Steps for which each is held."
)
@click.option(
    "--duration",
    "duration_s",
    type=seconds(),
    default="3s",
    show_default=True,
    help="Simulated time of the closed loop.",
)
@click.option(
    "--paths",
    "path_names",
    type=NAMES,
    help="Roll out by these (see `mjbench paths`) and python_loop, which is always added"
    "  [default: all C paths]",
)
@THREADS
@budget(60, "Time for the plans of each model and size; after it, the closed loop ends.")
@with_options(SEED, PLANNING_STARTS, LIMIT, STORING)
def plan(path_names: list[str] | None, output: OutputOptions, **options: Any) -> None:
    """How many plans per second does a sampling planner make, by the path that rolls them out?

    The planner runs in a closed loop on MODEL (default: cartpole, which must swing up its pole; any
    other model must hold its pose). At each control all paths roll out the same candidates in
    turns; their states must be bit-identical, so that all give the same plan. With --states, each
    plan starts from another state of the file.

    \b
    Examples:
      mjbench plan
      mjbench plan humanoid --algorithm cem --nbatch 128
      mjbench plan --nbatch 16,64,256 --knots 10,25 --threads 1,2
      mjbench plan robot.mjb --states states.npz
    """
    from mjbench.api.plan import measurement
    from mjbench.comparison.planning_run import PlanningRow
    from mjbench.report import planning

    work = measurement(
        **options,
        path_names=path_names,
        import_from=own_path_folder(path_names),
    )
    measure_and_print(
        work,
        output,
        each=lambda run: [planning.section(run.of_type(PlanningRow))],
        summary=lambda run: planning.sizes_sections(run.of_type(PlanningRow)),
    ).exit()
