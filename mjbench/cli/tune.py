"""`mjbench tune`: which settings make a model faster, and what they cost in accuracy."""

import contextlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mjbench.cli.context import OutputOptions, RunContext, measure_and_print
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
from mjbench.errors import InputError
from mjbench.simulation.models import ModelSource

if TYPE_CHECKING:
    from mjbench.api.session import Observer
    from mjbench.measuring.progress import Progress
    from mjbench.simulation.starts import StartPlan
    from mjbench.store.runs import Record

# Simulations of a batched step of MJX or Warp.
NBATCH = 64


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
    engine: str,
    nbatch: int | None,
    only: str | None,
    skip: list[str] | None,
    max_error: float | None,
    budget_s: float,
    target: str | None,
    hold: int,
    seed: int,
    starts: "StartPlan",
    time_limit: float,
    output: OutputOptions,
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
    from mjbench.api.session import Item, Measurement, finished, in_turn, input_files
    from mjbench.paired.worker_pool import WorkerPool
    from mjbench.tuning import knobs, variants
    from mjbench.tuning.records import Effect
    from mjbench.tuning.search_base import PARTS, SearchPlan
    from mjbench.tuning.tune import tune as tune_model

    _check_engine(engine, nbatch, only, skip)
    effect = Effect(only or Effect.APPROXIMATE)
    skipped = knobs.known(skip or ())
    plan = SearchPlan(
        seed, starts, budget_s, max_error, effect, hold, skipped, engine, nbatch or NBATCH
    )
    files = input_files(sources, [], starts)
    if target is not None:
        if len(sources) > 1:
            raise InputError("--write takes one model")
        variants.check_source(sources[0])
        with contextlib.closing(OutputFile("--write", target, files)) as file:
            file.open()  # fails now, rather than after the search, where it cannot be written

    def items(earlier: "Sequence[Record]", observer: "Observer") -> "Iterator[Item]":
        if target is not None:
            variants.copy_in_child(sources[0], None, Path(target), time_limit)
        with WorkerPool() as pool:

            def tuned(source: ModelSource, on_progress: "Progress") -> Item:
                def advance(done: int, text: str, share: float) -> None:
                    on_progress(text, (done + share) / PARTS)

                return Item([tune_model(pool, source, plan, time_limit, advance)])

            yield from in_turn(sources, tuned, earlier, observer)

    arguments = {"models": [source.name for source in sources], "plan": plan}
    measurement = Measurement("tune", arguments, files, items, finished)
    run = measure_and_print(measurement, output)
    if target is not None and not run.is_stopped:
        _write(run, sources[0], Path(target), time_limit)
    run.exit()


def _check_engine(
    engine: str, nbatch: int | None, only: str | None, skip: list[str] | None
) -> None:
    if engine == "c" and nbatch is not None:
        raise InputError("--nbatch needs --engine mjx or warp")
    if engine != "c" and only is not None:
        raise InputError("--only works with --engine c; use --max-error instead")
    if engine != "c" and skip is not None:
        raise InputError("--skip works with --engine c")


def _write(run: RunContext, source: ModelSource, target: Path, limit_s: float) -> None:
    from mjbench.tuning import variants
    from mjbench.tuning.records import TuneRecord
    from mjbench.tuning.settings import edits_of

    (record,) = run.session.run().of_type(TuneRecord)
    best = record.best()
    edits = edits_of(best.settings) if best else []
    if not edits:
        report_line(f"{target}: not written, because no settings of the file are recommended")
        return
    variants.copy_in_child(source, edits, target, limit_s)
    run.out.print(f"Wrote {target}", soft_wrap=True)
