"""`mjbench compare`: ways of stepping, on each model."""

from typing import TYPE_CHECKING

import click

from mjbench.cli.context import OutputOptions, measure_and_print
from mjbench.cli.group import cli
from mjbench.cli.shared import (
    CODE,
    COUNT,
    HOLD,
    LARGE_COUNT,
    LIMIT,
    NAMES,
    SEED,
    STARTS,
    STORING,
    THREADS,
    check_sizes,
    models_argument,
    numbers,
    own_path_folder,
    seconds,
    with_options,
)
from mjbench.errors import InputError
from mjbench.simulation.models import ModelSource

if TYPE_CHECKING:
    from mjbench.simulation.starts import StartPlan


@cli.command()
@models_argument()
@click.option(
    "--paths",
    "path_names",
    type=NAMES,
    help="Compare these (see `mjbench paths`), or MODULE:CLASS of your own, and python_loop, which"
    " is always added; `c` stands for all C paths, `usual` for those and, where installed, MJX"
    "  [default: c]",
)
@THREADS
@click.option("--chunk", type=numbers(), help="Simulations that a thread takes at a time.")
@click.option(
    "--option",
    "option_words",
    multiple=True,
    metavar="NAME=V,V",
    help="Values of any other option of a path, such as pool=new or checks=off.",
)
@click.option(
    "--nbatch",
    type=numbers(),
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
    type=seconds(),
    help="Time for each model, agreement included; what compiles comes on top  [default: 23s]",
)
@click.option(
    "--quick", is_flag=True, help="The same as --budget 5s: a first impression, mostly not certain."
)
@click.option(
    "--total-steps",
    type=LARGE_COUNT,
    help="Steps that you will take in all simulations together, such as 1e9: a path that compiles"
    " is advised only if that pays within them  [default: those of one block]",
)
@click.option(
    "--scaling",
    is_flag=True,
    help="How many threads? Race many numbers of threads, up to twice as many as can run at once,"
    " and chunk sizes, or those of --threads and --chunk. Only rollout and batch_step race, unless"
    " --paths names others.",
)
@CODE
@with_options(HOLD, SEED, STARTS, LIMIT, STORING)
def compare(
    sources: list[ModelSource],
    path_names: list[str] | None,
    threads: list[int] | None,
    chunk: list[int] | None,
    option_words: tuple[str, ...],
    nbatch: list[int] | None,
    returns: str,
    nstep: int | None,
    budget: float | None,
    quick: bool,
    total_steps: int | None,
    scaling: bool,
    code: bool,
    hold: int,
    seed: int,
    starts: "StartPlan",
    limit_s: float,
    output: OutputOptions,
) -> None:
    """Compare ways of stepping MODELs (default: all C paths): do they agree, and how fast are they?

    What they return is compared first, bit by bit; a path that disagrees gets no speed. Then they
    race: in one fresh process after the other, blocks of all paths are timed in turns, and paths
    that are certainly slower are dropped. MJX and Warp compile first; they are held to tolerances
    and timed alone. Raw samples go to a run file in results/runs; `mjbench show` prints it again.

    Without a MODEL: all shipped models.

    \b
    Examples:
      mjbench compare robot.xml
      mjbench compare humanoid --threads 1,2,4 --nbatch 256 --hold 5
      mjbench compare humanoid --scaling
      mjbench compare cartpole --paths mjx,rollout --nbatch 16,256,4096
    """
    from mjbench.api.model_comparison import measurement
    from mjbench.api.model_sources import each_once
    from mjbench.commands.compare import show as report
    from mjbench.simulation.workload import Product
    from mjbench.verification import selection
    from mjbench.verification.plan import ComparisonPlan

    check_sizes(nstep, hold)
    plan = ComparisonPlan(
        variants=(),
        nstep=nstep,
        hold=hold,
        seed=seed,
        starts=starts,
        returns=Product(returns),
        budget_s=_budget_s(budget, quick),
        limit_s=limit_s,
        import_from=own_path_folder(path_names),
        named=selection.named(path_names or []),
        total_steps=total_steps,
    )
    if scaling:
        path_names = path_names or list(selection.SCALING_PATHS)
        threads = threads or selection.scaling_threads()
        chunk = chunk or list(selection.SCALING_CHUNKS)
    plans = selection.plans(plan, path_names or [], threads, chunk, option_words, nbatch)
    measure_and_print(
        measurement(each_once(sources), plans),
        output,
        each=report.model_sections,
        summary=report.summary,
        code=code,
    ).exit()


def _budget_s(budget_s: float | None, is_quick: bool) -> float:
    from mjbench.verification.plan import BUDGET_S, QUICK_BUDGET_S

    if is_quick and budget_s is not None:
        raise InputError("--quick is a budget of 5 s: give it, or --budget")
    return budget_s or (QUICK_BUDGET_S if is_quick else BUDGET_S)
