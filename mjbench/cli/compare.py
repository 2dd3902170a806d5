"""`mjbench compare`: ways of stepping, on each model."""

import dataclasses
import functools
import itertools
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mjbench.cli.context import RunContext, Storage
from mjbench.cli.group import cli
from mjbench.cli.shared import (
    COUNT,
    HOLD,
    LIMIT,
    SEED,
    STARTS,
    STORING,
    Names,
    Numbers,
    Seconds,
    check_sizes,
    start_plan,
    with_options,
)
from mjbench.errors import MachineError
from mjbench.instrument.limits import MAX_THREADS
from mjbench.status import Status

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mjbench.comparison.plan import ComparisonPlan
    from mjbench.simulation.models import ModelSource


@dataclass(frozen=True)
class _Options:
    """The options of the command, as click parses them."""

    path_names: list[str] | None
    threads: list[int] | None
    chunk: list[int] | None
    option_words: tuple[str, ...]
    nbatch: list[int] | None
    nstep: int | None
    hold: int
    seed: int
    settle_s: float | None
    states_file: Path | None
    budget: float | None
    time_limit: float
    results: Path
    resume: Path | None
    wait: bool
    json_file: str | None


@cli.command()
@click.argument("names", nargs=-1, metavar="[MODEL]…")
@click.option(
    "--paths",
    "path_names",
    type=Names(),
    help="Compare these (see `mjbench paths`) and python_loop, which is always added; `c` stands"
    " for all C paths, `usual` for those and, where installed, MJX  [default: c]",
)
@click.option(
    "--threads", type=Numbers(MAX_THREADS), help="Thread counts  [default: 1 and usable cores]"
)
@click.option("--chunk", type=Numbers(), help="Simulations that a thread takes at a time.")
@click.option(
    "--option",
    "option_words",
    multiple=True,
    metavar="NAME=V,V",
    help="Values of any other option of a path, such as pool=new or record=qpos.",
)
@click.option(
    "--nbatch",
    type=Numbers(),
    help="Simulations; several values are measured one after the other  [default: up to 64]",
)
@click.option("--nstep", type=COUNT, help="Steps of each simulation  [default: up to 200]")
@click.option(
    "--budget",
    type=Seconds(zero=True),
    help="Time to spend on timing each model  [default: 8s]",
)
@with_options(HOLD, SEED, *STARTS, LIMIT, *STORING)
def compare(names: tuple[str, ...], **options: Any) -> None:
    """Compare ways of stepping MODELs (default: all C paths): do they agree, and how fast are they?

    Final states are compared first, bit by bit; a path that disagrees gets no speed. Then blocks
    of every path are timed in turns. MJX and Warp compile first; they are held to tolerances and
    timed alone, each in a process of its own. Raw samples go to a run file in results/runs;
    `mjbench show` prints it again.

    Without a MODEL: all shipped models.
    """
    from mjbench.simulation.models import resolve, shipped

    parsed = _Options(**options)
    check_sizes(parsed.nstep, parsed.hold)
    sources = [resolve(name) for name in names or shipped()]
    sources = list({source.path: source for source in sources}.values())
    _compare(sources, _plans(parsed), parsed)


def _plans(options: _Options) -> list["ComparisonPlan"]:
    """Return one plan for each size of the sweep."""
    from mjbench.comparison import selection
    from mjbench.comparison.plan import BUDGET_S, ComparisonPlan

    has_own_path = any(":" in name for name in options.path_names or ())
    if has_own_path:
        sys.path.insert(0, str(Path.cwd()))
    path_names = selection.expand(options.path_names or [])
    choices = selection.choices(options.option_words, path_names)
    if options.chunk:
        choices["chunk"] = options.chunk
    sizes: list[int | None] = [*options.nbatch] if options.nbatch else [None]
    if path_names and len(sizes) > 1:
        path_names = [*path_names, *selection.rivals(path_names)]
    plan = ComparisonPlan(
        variants=selection.variants(path_names, options.threads, choices),
        nstep=options.nstep,
        hold=options.hold,
        seed=options.seed,
        starts=start_plan(options.settle_s, options.states_file),
        budget_s=BUDGET_S if options.budget is None else options.budget,
        limit_s=options.time_limit,
        import_from=str(Path.cwd()) if has_own_path else None,
        named=tuple(n for n in options.path_names or () if n != selection.USUAL_PATHS),
    )
    return [dataclasses.replace(plan, nbatch=size) for size in sizes]


def _compare(
    sources: "Sequence[ModelSource]", plans: "Sequence[ComparisonPlan]", options: _Options
) -> None:
    from mjbench.comparison import compare
    from mjbench.comparison.records import finished
    from mjbench.instrument.runs import to_json
    from mjbench.paths import user_module_files
    from mjbench.report import comparison as report
    from mjbench.report.crossovers import crossovers
    from mjbench.report.documents import CompareDocument
    from mjbench.report.results import PathResult, derive

    arguments = {**to_json(plans[0]), "models": [source.name for source in sources]}
    arguments["nbatch"] = [plan.nbatch for plan in plans]
    nvariant = len(plans[0].variants)
    storage = Storage(
        options.results, arguments, options.resume, lambda records: finished(records, nvariant)
    )
    results: list[PathResult] = []
    statuses: list[Status] = []
    failure: MachineError | None = None
    turns = list(itertools.product(sources, plans))
    files = [source.path for source in sources]
    files += user_module_files(variant.path for variant in plans[0].variants)
    files += [plans[0].starts.file] if plans[0].starts.file else []
    with RunContext("compare", options.json_file, files, storage, options.wait) as run:
        with run.progress(len(turns)) as advance:
            for number, (source, plan) in enumerate(turns):
                records = compare.stored(source, plan, run.resumed_records)
                if records is None:
                    on_progress = functools.partial(advance, number)
                    records = compare.compare_model(source, plan, on_progress)
                    try:
                        for record in records.all:
                            run.record(record)
                    except MachineError as error:
                        failure = error
                model_results = derive(records.model, records.measurements)
                report.print_model(run.out, model_results)
                results += model_results.results
                statuses += [records.model.status, *(r.status for r in model_results.results)]
                if records.interrupted:
                    run.interrupt()
                if records.interrupted or failure:
                    break
        report.print_crossovers(run.out, crossovers(results))
        run.write(CompareDocument.of(run.machine, results))
    if failure:
        raise failure
    run.exit(statuses)
