"""`mjbench plan`: plans per second of a sampling planner, by the path that rolls out."""

import itertools
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

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
    STATES,
    WAIT,
    Names,
    Numbers,
    Seconds,
    own_path_folder,
    start_plan,
    with_options,
)
from mjbench.errors import Failure
from mjbench.limits import MAX_THREADS
from mjbench.status import Status

if TYPE_CHECKING:
    from collections.abc import Iterator

    from mjbench.comparison.planning_run import PlanningRequest, PlanningRow
    from mjbench.simulation.models import ModelSource
    from mjbench.simulation.starts import StartPlan


@dataclass(frozen=True)
class _Options:
    """The options of the command, as click parses them."""

    algorithm: str
    samples: list[int]
    knots: list[int]
    hold: int
    duration_s: float
    path_names: list[str] | None
    threads: list[int] | None
    seed: int
    states_file: Path | None
    time_limit: float
    results: Path
    wait: bool
    json_file: str | None


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
@with_options(SEED, STATES, LIMIT, RESULTS, WAIT, JSON)
def plan(names: tuple[str, ...], **options: Any) -> None:
    """How many plans per second does a sampling planner make, by the path that rolls them out?

    The planner runs in a closed loop on MODEL (default: cartpole, which must swing up its pole; any
    other model must hold its pose). At each control all paths roll out the same candidates in
    turns; their states must be bit-identical, so that all give the same plan. With --states, each
    plan starts from another state of the file.

    \b
    Examples:
      mjbench plan
      mjbench plan humanoid --algorithm cem --samples 128
      mjbench plan --samples 16,64,256 --knots 10,25 --threads 1,2
      mjbench plan robot.mjb --states states.npz
    """
    from mjbench.comparison.planning_run import PlanningRow
    from mjbench.report.kinds import PLAN
    from mjbench.report.planning import section, sizes_sections
    from mjbench.simulation import models

    parsed = _Options(**options)
    sources = [models.resolve(name) for name in names or ("cartpole",)]
    starts = start_plan(None, parsed.states_file)
    import_from = own_path_folder(parsed.path_names)
    requests = [request for source in sources for request in _requests(source, parsed, starts)]
    rows: list[PlanningRow] = []
    statuses: list[Status] = []
    arguments = {
        "models": [source.name for source in sources],
        "variants": requests[0].variants,
        "settings": list(dict.fromkeys(request.settings for request in requests)),
        "hold": parsed.hold,
        "duration_s": parsed.duration_s,
        "starts": starts,
    }
    storage = Storage(parsed.results, arguments)
    files = [*(source.path for source in sources), *starts.files]
    with RunContext("plan", parsed.json_file, files, storage, parsed.wait) as run:
        for request in requests:
            planned = _plan(request, import_from, parsed.time_limit)
            if isinstance(planned, Failure):
                statuses.append(planned.status)
                continue
            run.show([section(planned)])
            for row in planned:
                run.record(row)
            rows += planned
            statuses += [row.status for row in planned]
        run.show(sizes_sections(rows))
        run.write_results(PLAN)
    run.exit(statuses)


def _requests(
    source: "ModelSource", options: _Options, starts: "StartPlan"
) -> "Iterator[PlanningRequest]":
    """Yield a request for each size of plans."""
    from mjbench.comparison import selection
    from mjbench.comparison.planner import Algorithm, PlannerSettings
    from mjbench.comparison.planning_run import PlanningRequest
    from mjbench.host import machine

    threads = options.threads or [machine.usable_cores()]
    variants = selection.variants(options.path_names or [], threads)
    for samples, knots in itertools.product(options.samples, options.knots):
        settings = PlannerSettings(Algorithm(options.algorithm), samples, knots, seed=options.seed)
        yield PlanningRequest(
            source, variants, settings, options.hold, options.duration_s, starts.file
        )


def _plan(
    request: "PlanningRequest", import_from: str | None, limit_s: float
) -> "list[PlanningRow] | Failure":
    from mjbench.comparison import planning_run

    return measure_or_report(
        request.source, lambda source: planning_run.run(request, import_from, limit_s)
    )
