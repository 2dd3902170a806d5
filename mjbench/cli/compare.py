"""`mjbench compare`: ways of stepping, on each model."""

import functools
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mjbench.cli.context import RunContext, Storage
from mjbench.cli.group import cli
from mjbench.cli.shared import (
    CODE,
    CODE_HINT,
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
from mjbench.limits import MAX_THREADS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import RenderableType

    from mjbench.comparison.plan import ComparisonPlan
    from mjbench.paired.path_comparison import ModelComparison
    from mjbench.report.results import ModelResults
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
    returns: str
    seed: int
    settle_s: float | None
    states_file: Path | None
    actions_file: Path | None
    budget: float | None
    total_steps: int | None
    quick: bool
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
@click.option("--nstep", type=COUNT, help="Steps of each simulation  [default: up to 100]")
@click.option(
    "--budget",
    type=Seconds(),
    help="Time for each model, agreement included; what compiles comes on top  [default: 24s]",
)
@click.option(
    "--quick", is_flag=True, help="The same as --budget 5s: a first impression, mostly not certain."
)
@click.option(
    "--total-steps",
    type=LargeCount(),
    help="Steps that you will take in all: a path that compiles is advised only if that pays within"
    " them  [default: those of one block]",
)
@click.option(
    "--scaling",
    is_flag=True,
    help="Let many numbers of threads, up to twice as many as can run at once, and chunk sizes take"
    " part; --threads and --chunk name them  [paths by default: rollout, batch_step]",
)
@CODE
@with_options(HOLD, SEED, *STARTS, LIMIT, *STORING)
def compare(names: tuple[str, ...], **options: Any) -> None:
    """Compare ways of stepping MODELs (default: all C paths): do they agree, and how fast are they?

    What they return is compared first, bit by bit; a path that disagrees gets no speed. Then they
    race: in one fresh process after the other, blocks of all paths are timed in turns, and paths
    that are certainly slower leave. MJX and Warp compile first; they are held to tolerances and
    timed alone. Raw samples go to a run file in results/runs; `mjbench show` prints it again.

    Without a MODEL: all shipped models.

    \b
    Examples:
      mjbench compare robot.xml
      mjbench compare humanoid --threads 1,2,4 --nbatch 256 --hold 5
      mjbench compare humanoid --scaling
      mjbench compare cartpole --paths mjx,rollout --nbatch 16,256,4096
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

    import_from = own_path_folder(options.path_names)
    path_names, threads, chunk = options.path_names or [], options.threads, options.chunk
    if options.scaling:
        path_names = path_names or list(selection.SCALING_PATHS)
        threads = threads or selection.scaling_threads()
        chunk = chunk or list(selection.SCALING_CHUNKS)
    return selection.plans(
        _plan(options, import_from),
        path_names,
        threads,
        chunk,
        options.option_words,
        options.nbatch,
    )


def _plan(options: _Options, import_from: str | None) -> "ComparisonPlan":
    """Return the plan that the options ask for, with variants and size left open."""
    from mjbench.comparison import selection
    from mjbench.comparison.plan import ComparisonPlan
    from mjbench.simulation.workload import Product

    return ComparisonPlan(
        variants=(),
        nstep=options.nstep,
        hold=options.hold,
        seed=options.seed,
        starts=start_plan(options.settle_s, options.states_file, options.actions_file),
        returns=Product(options.returns),
        budget_s=_budget_s(options),
        limit_s=options.time_limit,
        import_from=import_from,
        named=selection.named(options.path_names or []),
        total_steps=options.total_steps,
    )


def _budget_s(options: _Options) -> float:
    """Return the seconds that a model may take."""
    from mjbench.comparison.plan import BUDGET_S, QUICK_BUDGET_S

    if options.quick and options.budget is not None:
        raise InputError("--quick is a budget of 5 s: give it, or --budget")
    return options.budget or (QUICK_BUDGET_S if options.quick else BUDGET_S)


def _compare(
    sources: "Sequence[ModelSource]", plans: "Sequence[ComparisonPlan]", options: _Options
) -> None:
    from mjbench.paired.path_comparison import compare_model, finished, stored
    from mjbench.paired.worker_pool import WorkerPool
    from mjbench.paths import user_module_files
    from mjbench.report import comparison as report
    from mjbench.report.advice import advise
    from mjbench.report.documents import CompareDocument
    from mjbench.report.results import derive
    from mjbench.store.runs import to_json

    arguments = {**to_json(plans[0]), "models": [source.name for source in sources]}
    arguments["nbatch"] = [plan.nbatch for plan in plans]
    nvariant = len(plans[0].variants)
    storage = Storage(
        options.results, arguments, options.resume, lambda records: finished(records, nvariant)
    )
    models: list[ModelResults] = []
    files = [source.path for source in sources]
    files += user_module_files(variant.path for variant in plans[0].variants)
    files += plans[0].starts.files
    failure: MachineError | None = None
    with RunContext("compare", options.json_file, files, storage, options.wait) as run:
        with (
            run.progress(len(sources) * len(plans)) as bar,
            WorkerPool(options.time_limit) as pool,
        ):
            for source in sources:
                sizes: list[ModelResults] = []
                for plan in plans:
                    stored_earlier = stored(source, plan, run.resumed_records)
                    on_progress = functools.partial(bar, len(models) + len(sizes))
                    for known in (
                        [stored_earlier]
                        if stored_earlier
                        else compare_model(pool, source, plan, on_progress, bar.begin)
                    ):
                        bar.show(functools.partial(_shown_so_far, run.out.width, sizes, known))
                    sizes.append(derive(known.model, known.measurements, known.race))
                    try:
                        for record in () if stored_earlier else known.records:
                            run.record(record)
                    except MachineError as error:
                        failure = error
                    if known.is_interrupted:
                        run.interrupt()
                    if known.is_interrupted or failure:
                        break
                bar.show(None)
                run.show([report.model_section(sizes)], options.code)
                models += sizes
                if run.interrupted or failure:
                    break
        run.show(report.sections_together(models))
        if not options.code and any(advise(results) for results in models):
            run.out.print(CODE_HINT, soft_wrap=True)
        run.write(CompareDocument.of(run.machine, models))
    if failure:
        raise failure
    run.exit(status for results in models for status in results.statuses)


def _shown_so_far(
    width: int, sizes: "Sequence[ModelResults]", known: "ModelComparison"
) -> "RenderableType | None":
    """Return what a terminal shows of a model while one of its sizes is measured."""
    from rich.console import Group

    from mjbench.pages import terminal
    from mjbench.report import comparison as report
    from mjbench.report.results import derive

    results = derive(known.model, known.measurements, known.race)
    section = report.section_so_far([*sizes, results])
    return None if section is None else Group(*terminal.section_parts(section, width))
