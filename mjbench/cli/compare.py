"""`mjbench compare`: ways of stepping, on each model."""

import contextlib
import functools
import itertools
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mjbench.cli.context import OutputOptions, RunContext, Storage
from mjbench.cli.group import cli
from mjbench.cli.shared import (
    CODE,
    COUNT,
    HOLD,
    LIMIT,
    SEED,
    STARTS,
    STORING,
    LargeCount,
    Names,
    Numbers,
    Seconds,
    check_sizes,
    own_path_folder,
    start_plan,
    with_options,
)
from mjbench.errors import InputError, MachineError
from mjbench.instrument.limits import MAX_THREADS
from mjbench.status import FINISHED, Status

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mjbench.comparison.plan import ComparisonPlan
    from mjbench.comparison.scaling import ScalingRequest
    from mjbench.instrument.runs import Record
    from mjbench.simulation.models import ModelSource

# Share of the bar of a model that measuring it has, where paths are compared again after that.
_MEASURED_SHARE = 0.5


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
    returns: str
    seed: int
    settle_s: float | None
    states_file: Path | None
    actions_file: Path | None
    budget: float | None
    total_steps: int | None
    confirm: bool
    scaling: bool
    code: bool
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
    " for all C paths but ray, `usual` for those and, where installed, MJX  [default: c]",
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
    help="Values of any other option of a path, such as pool=new or checks=off.",
)
@click.option(
    "--nbatch",
    type=Numbers(),
    help="Simulations; several values are measured one after the other  [default: up to 64]",
)
@click.option(
    "--returns",
    type=click.Choice(("final", "trajectory", "sensors")),
    default="final",
    show_default=True,
    help="What every path returns: final states; the state after every step, too; and sensor data"
    " of every step, too, which are of the state before it.",
)
@click.option("--nstep", type=COUNT, help="Steps of each simulation  [default: up to 200]")
@click.option(
    "--budget",
    type=Seconds(zero=True),
    help="Time to spend on timing each model  [default: 8s]",
)
@click.option(
    "--total-steps",
    type=LargeCount(),
    help="Steps that you will take in all: a path that compiles is advised only if that pays within"
    " them  [default: those of one block]",
)
@click.option(
    "--confirm/--no-confirm",
    default=True,
    show_default=True,
    help="Compare the paths that may be the fastest again in fresh processes, up to 40 seconds a"
    " model; without it, only the plain loop is advised.",
)
@click.option(
    "--scaling",
    is_flag=True,
    help="Search how many threads, which chunk size, and how many simulations: from one thread to"
    " twice as many as can run at once. --threads, --chunk and --nbatch fix what is tried. It takes"
    " about three times the --budget, and up to 20 seconds for each"
    " comparison in fresh processes."
    "  [paths by default: rollout, batch_step]",
)
@CODE
@with_options(HOLD, SEED, *STARTS, LIMIT, *STORING)
def compare(names: tuple[str, ...], **options: Any) -> None:
    """Compare ways of stepping MODELs (default: all C paths): do they agree, and how fast are they?

    What they return is compared first, bit by bit; a path that disagrees gets no speed. Then
    blocks of every path are timed in turns. MJX and Warp compile first; they are held to
    tolerances and timed alone, each in a process of its own. What is advised was compared again in
    fresh processes. Raw samples go to a run file in results/runs; `mjbench show` prints it again.

    Without a MODEL: all shipped models.

    \b
    Examples:
      mjbench compare robot.xml
      mjbench compare humanoid --threads 1,2,4 --nbatch 256 --hold 5
      mjbench compare humanoid --scaling
      mjbench compare cartpole --paths mjx,rollout --nbatch 16,256,4096
    """
    from mjbench.cli.compare_scaling import search_models
    from mjbench.simulation.models import resolve, shipped

    parsed = _Options(**options)
    check_sizes(parsed.nstep, parsed.hold)
    sources = [resolve(name) for name in names or shipped()]
    sources = list({source.path: source for source in sources}.values())
    if parsed.scaling:
        output = OutputOptions(parsed.results, parsed.resume, parsed.wait, parsed.json_file)
        request = _scaling_request(parsed)
        search_models(sources, request, output, parsed.confirm, parsed.code)
    else:
        _compare(sources, _plans(parsed), parsed)


def _scaling_request(options: _Options) -> "ScalingRequest":
    """Return what --scaling is to search.

    Raises:
      InputError: an option that a search has no use for, or a path without threads.
    """
    from mjbench.comparison import scaling, selection
    from mjbench.comparison.scaling import ScalingRequest
    from mjbench.instrument import topology

    if options.total_steps is not None:
        raise InputError("--total-steps has no effect with --scaling, where no path compiles")
    import_from = own_path_folder(options.path_names)
    given = options.path_names or list(scaling.USUAL_PATHS)
    expanded = selection.expand(given)
    choices = selection.choices(options.option_words, expanded)
    several = [name for name, values in choices.items() if len(values) > 1]
    if "chunk" in choices:
        raise InputError("--option chunk: give --chunk with --scaling")
    if several:
        raise InputError(f"--option {several[0]}: give one value with --scaling")
    return ScalingRequest(
        plan=_plan(options, import_from),
        path_names=[n for n in expanded if n in given or scaling.parallel_option(n)],
        options={name: value for name, (value,) in choices.items()},
        topology=topology.read(),
        thread_counts=options.threads,
        chunk_sizes=options.chunk,
        nbatch=options.nbatch,
    )


def _plans(options: _Options) -> list["ComparisonPlan"]:
    """Return one plan for each size of the sweep."""
    from mjbench.comparison import selection

    import_from = own_path_folder(options.path_names)
    return selection.plans(
        _plan(options, import_from),
        options.path_names or [],
        options.threads,
        options.chunk,
        options.option_words,
        options.nbatch,
    )


def _plan(options: _Options, import_from: str | None) -> "ComparisonPlan":
    """Return the plan that the options ask for, with variants and size left open."""
    from mjbench.comparison import selection
    from mjbench.comparison.plan import BUDGET_S, ComparisonPlan
    from mjbench.simulation.workload import Product

    return ComparisonPlan(
        variants=(),
        nstep=options.nstep,
        hold=options.hold,
        seed=options.seed,
        starts=start_plan(options.settle_s, options.states_file, options.actions_file),
        returns=Product(options.returns),
        budget_s=BUDGET_S if options.budget is None else options.budget,
        limit_s=options.time_limit,
        import_from=import_from,
        named=selection.named(options.path_names or []),
        total_steps=options.total_steps,
    )


def _compare(
    sources: "Sequence[ModelSource]", plans: "Sequence[ComparisonPlan]", options: _Options
) -> None:
    from mjbench.api.confirmation import Confirmation
    from mjbench.comparison import compare
    from mjbench.instrument.progress import part_of
    from mjbench.instrument.runs import to_json
    from mjbench.paths import user_module_files
    from mjbench.report import comparison as report
    from mjbench.report.documents import CompareDocument
    from mjbench.report.results import ModelResults, derive

    arguments = {**to_json(plans[0]), "models": [source.name for source in sources]}
    arguments["nbatch"] = [plan.nbatch for plan in plans]
    nvariant = len(plans[0].variants)
    storage = Storage(
        options.results, arguments, options.resume, lambda records: _finished(records, nvariant)
    )
    models: list[ModelResults] = []
    statuses: list[Status] = []
    failure: MachineError | None = None
    turns = list(itertools.product(sources, plans))
    files = [source.path for source in sources]
    files += user_module_files(variant.path for variant in plans[0].variants)
    files += plans[0].starts.files
    with RunContext("compare", options.json_file, files, storage, options.wait) as run:
        with run.progress(len(turns)) as advance, contextlib.ExitStack() as closing:
            confirmation = Confirmation(run.record, closing)
            for number, (source, plan) in enumerate(turns):
                on_progress = functools.partial(advance, number)
                measured = _MEASURED_SHARE if options.confirm else 1.0
                records = compare.stored(source, plan, run.resumed_records)
                if records is None:
                    on_measuring = part_of(on_progress, 0.0, measured)
                    records = compare.compare_model(source, plan, on_measuring)
                    try:
                        for record in records.all:
                            run.record(record)
                    except MachineError as error:
                        failure = error
                results = derive(records.model, records.measurements, run.resumed_records)
                is_over = records.interrupted or failure is not None
                if options.confirm and not is_over:
                    on_confirming = part_of(on_progress, measured, 1.0)
                    results = confirmation.complete(source, plan, results, on_confirming)
                report.print_model(run.out, results, options.code)
                models.append(results)
                statuses += [records.model.status, *(r.status for r in results.results)]
                if records.interrupted or confirmation.is_interrupted:
                    run.interrupt()
                if is_over or confirmation.is_interrupted:
                    break
        report.print_crossovers(run.out, models)
        if len(models) > 1:
            report.print_summary(run.out, models)
        if not options.code:
            report.print_code_hint(run.out, models)
        run.write(CompareDocument.of(run.machine, models))
    if failure:
        raise failure
    run.exit(statuses)


def _finished(records: "Sequence[Record]", nvariant: int) -> "list[Record]":
    """Return the records that need not be measured again: of models, and of fresh processes."""
    from mjbench.comparison.records import ModelRecord, finished
    from mjbench.report.results import again_of

    done: list[Record] = []
    for record in finished(records, nvariant):
        done.append(record)
        if isinstance(record, ModelRecord):
            done += [c for c in again_of(record, records) if c.status in FINISHED]
    return done
