"""`mjbench plan`: plans per second of a sampling planner, by the path that rolls out."""

import functools
import itertools
from pathlib import Path

import click

from mjbench.cli.context import RunContext, Storage
from mjbench.cli.each_model import measure_or_report
from mjbench.cli.group import cli
from mjbench.cli.shared import (
    COUNT,
    JSON,
    LIMIT,
    RESULTS,
    SEED,
    WAIT,
    Names,
    Numbers,
    Seconds,
    own_path_folder,
    with_options,
)
from mjbench.errors import Failure
from mjbench.instrument.limits import MAX_THREADS
from mjbench.status import Status


@cli.command()
@click.argument("names", nargs=-1, metavar="[MODEL]…")
@click.option(
    "--algorithm",
    type=click.Choice(("predictive-sampling", "mppi", "cem")),
    default="mppi",
    show_default=True,
    help="How the plan improves.",
)
@click.option(
    "--samples",
    type=Numbers(),
    default="64",
    show_default=True,
    help="Candidates of a plan; several numbers are tried one after the other.",
)
@click.option(
    "--knots",
    type=Numbers(),
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
    type=Seconds(),
    default="3s",
    show_default=True,
    help="Simulated time of the closed loop.",
)
@click.option(
    "--paths",
    "path_names",
    type=Names(),
    help="Roll out by these (see `mjbench paths`) and python_loop, which is always added"
    "  [default: all C paths]",
)
@click.option("--threads", type=Numbers(MAX_THREADS), help="Thread counts  [default: usable cores]")
@with_options(SEED, LIMIT, RESULTS, WAIT, JSON)
def plan(
    names: tuple[str, ...],
    algorithm: str,
    samples: list[int],
    knots: list[int],
    hold: int,
    duration_s: float,
    path_names: list[str] | None,
    threads: list[int] | None,
    seed: int,
    time_limit: float,
    results: Path,
    wait: bool,
    json_file: str | None,
) -> None:
    """How many plans per second does a sampling planner make, by the path that rolls them out?

    The planner runs in a closed loop on MODEL (default: cartpole, which must swing up its pole; any
    other model must hold its pose). At each control all paths roll out the same candidates in
    turns; their states must be bit-identical, so that all give the same plan.

    \b
    Examples:
      mjbench plan
      mjbench plan humanoid --algorithm cem --samples 128
      mjbench plan --samples 16,64,256 --knots 10,25 --threads 1,2
    """
    from mjbench.comparison import planning_run, selection
    from mjbench.comparison.planner import Algorithm, PlannerSettings
    from mjbench.comparison.planning_run import PlanningRequest, PlanningRow
    from mjbench.instrument import machine
    from mjbench.instrument.runs import to_json
    from mjbench.report.documents import PlanDocument
    from mjbench.report.planning import print_rows, print_sizes
    from mjbench.simulation import models
    from mjbench.simulation.models import ModelSource

    import_from = own_path_folder(path_names)
    sources = [models.resolve(name) for name in names or ("cartpole",)]
    variants = selection.variants(path_names or [], threads or [machine.usable_cores()])
    all_settings = [
        PlannerSettings(Algorithm(algorithm), number, count, seed=seed)
        for number, count in itertools.product(samples, knots)
    ]

    def plans_of(source: ModelSource, settings: PlannerSettings) -> list[PlanningRow]:
        request = PlanningRequest(source, variants, settings, hold, duration_s)
        return planning_run.run(request, import_from, time_limit)

    rows: list[PlanningRow] = []
    statuses: list[Status] = []
    files = [source.path for source in sources]
    arguments = {
        "models": [source.name for source in sources],
        "variants": to_json(variants),
        "settings": to_json(all_settings),
        "hold": hold,
        "duration_s": duration_s,
    }
    with RunContext("plan", json_file, files, Storage(results, arguments), wait) as run:
        for source, settings in itertools.product(sources, all_settings):
            planned = measure_or_report(
                source,
                functools.partial(plans_of, settings=settings),
            )
            if isinstance(planned, Failure):
                statuses.append(planned.status)
                continue
            print_rows(run.out, planned)
            rows += planned
            for row in planned:
                run.record(row)
            statuses += [row.status for row in planned]
        print_sizes(run.out, rows)
        run.write(PlanDocument(machine=run.machine, results=rows))
    run.exit(statuses)
