"""`mjbench plan`: plans per second of a sampling planner, by the path that rolls out."""

import itertools
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

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
from mjbench.errors import MjbenchError
from mjbench.simulation.models import ModelSource

if TYPE_CHECKING:
    from mjbench.api.session import Item, Observer
    from mjbench.comparison.planning_run import PlanningRequest
    from mjbench.simulation.starts import StartPlan
    from mjbench.store.runs import Record


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
def plan(
    sources: list[ModelSource],
    algorithm: str,
    samples: list[int],
    knots: list[int],
    hold: int,
    duration_s: float,
    path_names: list[str] | None,
    threads: list[int] | None,
    budget_s: float,
    seed: int,
    starts: "StartPlan",
    time_limit: float,
    output: OutputOptions,
) -> None:
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
    from mjbench.api.session import Item, Measurement, finished, input_files
    from mjbench.comparison import planning_run, selection
    from mjbench.comparison.planner import Algorithm, PlannerSettings
    from mjbench.comparison.planning_run import PlanningRequest, PlanningRow
    from mjbench.report import planning

    import_from = own_path_folder(path_names)
    variants = selection.variants(path_names or [], threads)
    settings = [
        PlannerSettings(Algorithm(algorithm), nsample, nknot, seed=seed)
        for nsample, nknot in itertools.product(samples, knots)
    ]
    requests = [
        PlanningRequest(source, variants, each, hold, duration_s, starts.file, budget_s)
        for source, each in itertools.product(sources, settings)
    ]

    def items(earlier: "Sequence[Record]", observer: "Observer") -> "Iterator[Item]":
        for number, request in enumerate(requests):
            observer(request.source.name, number / len(requests))
            known = planning_run.stored(request, earlier)
            yield Item(known) if known else _plan_model(request, import_from, time_limit)

    def whole(records: "Sequence[Record]") -> "list[Record]":
        ended = finished(records)
        return [row for request in requests for row in planning_run.stored(request, ended)]

    arguments = {
        "models": [source.name for source in sources],
        "variants": variants,
        "settings": list(dict.fromkeys(settings)),
        "hold": hold,
        "duration_s": duration_s,
        "budget_s": budget_s,
        "starts": starts,
    }
    files = input_files(sources, [], starts)
    measure_and_print(
        Measurement("plan", arguments, files, items, whole),
        output,
        each=lambda run: [planning.section(run.of_type(PlanningRow))],
        summary=lambda run: planning.sizes_sections(run.of_type(PlanningRow)),
    ).exit()


def _plan_model(request: "PlanningRequest", import_from: str | None, limit_s: float) -> "Item":
    from mjbench.api.session import Item, failure_of_model
    from mjbench.comparison import planning_run

    try:
        return Item(planning_run.run(request, import_from, limit_s))
    except MjbenchError as error:
        return Item(failure=failure_of_model(request.source.name, error))
