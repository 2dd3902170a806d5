"""Paths and models: compare, show, models, paths."""

import dataclasses
import functools
import itertools
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mjbench.cli.group import cli
from mjbench.cli.shared import (
    HOLD,
    INTERRUPTED,
    JSON,
    LIMIT,
    RESULTS,
    SEED,
    Numbers,
    Words,
    check_sizes,
    exit_code,
    output,
    progress,
)
from mjbench.errors import InputError, MachineError

if TYPE_CHECKING:
    from mjbench.comparison.compare import ComparisonPlan
    from mjbench.simulation.models import ModelSource


@cli.command()
@click.argument("names", nargs=-1, metavar="[MODEL]…")
@click.option(
    "--paths",
    "path_names",
    type=Words(),
    help="Only these (`mjbench paths`); `c` is all C paths, `usual` those and MJX  [default: c]",
)
@click.option("--threads", type=Numbers(), help="Thread counts  [default: 1 and usable cores]")
@click.option("--chunk", type=Numbers(), help="Simulations a thread takes at a time.")
@click.option(
    "--option",
    "chosen",
    multiple=True,
    metavar="NAME=V,V",
    help="Values of any other option of a path, such as pool=new or record=qpos.",
)
@click.option(
    "--nbatch", type=Numbers(), help="Simulations; several are a sweep  [default: up to 64]"
)
@click.option("--nstep", type=click.IntRange(min=1), help="Steps of each  [default: up to 200]")
@HOLD
@SEED
@click.option(
    "--budget",
    type=click.FloatRange(min=0.0),
    metavar="SECONDS",
    help="Time to spend on timing each model  [default: 8]",
)
@LIMIT
@RESULTS
@JSON
def compare(
    names: tuple[str, ...],
    path_names: list[str] | None,
    threads: list[int] | None,
    chunk: list[int] | None,
    chosen: tuple[str, ...],
    nbatch: list[int] | None,
    nstep: int | None,
    hold: int,
    seed: int,
    budget: float | None,
    time_limit: float,
    results: Path,
    json_file: str | None,
) -> None:
    """Compare all ways of stepping MODELs: speed, and whether they compute the same.

    \b
    Final states are compared first, bit by bit; a path that disagrees gets no speed.
    Blocks of every path are timed in turns. MJX and Warp, which compile first, are held to
    tolerances and timed alone, in a process each. Raw samples go to a run file in
    results/runs; `mjbench show` prints it again.
    """
    from mjbench.comparison import compare as room
    from mjbench.comparison import measure, selection
    from mjbench.paths import nthread
    from mjbench.simulation import models

    check_sizes(nstep, hold)
    sources = [models.resolve(name) for name in names or models.shipped()]
    sources = list({source.path: source for source in sources}.values())
    own = any(":" in name for name in path_names or ())
    if own:
        sys.path.insert(0, str(Path.cwd()))
    asked = selection.expanded(path_names or [])
    choices = selection.choices(chosen, asked)
    if chunk:
        choices["chunk"] = chunk
    sweep: list[int | None] = [*nbatch] if nbatch else [None]
    if asked and len(sweep) > 1:
        asked = [*asked, *selection.rivals(asked)]
    variants = selection.variants(asked, threads, choices)
    largest = max(nthread(options) for _, options in variants)
    plan = room.ComparisonPlan(
        variants=variants,
        nstep=nstep,
        hold=hold,
        seed=seed,
        budget_s=measure.BUDGET_S if budget is None else budget,
        limit_s=time_limit,
        largest=largest,
        import_from=str(Path.cwd()) if own else None,
        named=tuple(name for name in path_names or () if name != "usual"),
    )
    plans = [dataclasses.replace(plan, nbatch=size) for size in sweep]
    sys.exit(_compare(sources, plans, results, json_file))


def _compare(
    sources: Sequence["ModelSource"],
    plans: Sequence["ComparisonPlan"],
    folder: Path,
    json_file: str | None,
) -> int:
    from mjbench.comparison import compare as room
    from mjbench.instrument import machine
    from mjbench.instrument.runs import RunFile
    from mjbench.report import results as derive
    from mjbench.report import tables

    about = machine.describe()
    with output(json_file) as write_json:
        arguments = {"models": [s.name for s in sources], **plans[0].as_dict()}
        arguments["nbatch"] = [plan.nbatch for plan in plans]
        run_file = RunFile(folder, "compare", {"machine": about, "arguments": arguments})
        out = tables.console(stderr=json_file == "-")
        found: list[dict[str, Any]] = []
        interrupted = False
        failure: MachineError | None = None
        turns = list(itertools.product(sources, plans))
        with progress(out, len(turns)) as advance:
            for number, (source, plan) in enumerate(turns):
                outcome = room.compare_model(source, plan, functools.partial(advance, number))
                try:
                    for record in outcome.records:
                        run_file.append(record)
                except MachineError as error:
                    failure = error
                found += tables.model_report(out, outcome.records)
                interrupted = outcome.interrupted
                if interrupted or failure:
                    break
        tables.print_crossovers(out, found)
        run_file.close()
        write_json(derive.document(about, found))
    out.print(f"\nRun file: {run_file.path}", soft_wrap=True)
    if failure:
        raise failure
    if interrupted:
        click.echo("mjbench: interrupted; what was measured is kept", err=True)
        return INTERRUPTED
    return exit_code(result["status"] for result in found)


@cli.command()
@click.argument("file", required=False, type=click.Path(path_type=Path))
@RESULTS
@JSON
def show(file: Path | None, results: Path, json_file: str | None) -> None:
    """Print a run FILE again (default: the newest in results/runs)."""
    from mjbench.instrument import runs
    from mjbench.paired import selfcheck
    from mjbench.report import results as derive
    from mjbench.report import tables, verdicts

    header, *records = runs.load(file or runs.latest(results))
    out = tables.console(stderr=json_file == "-")
    found: list[dict[str, Any]] = []
    with output(json_file) as write_json:
        kinds = {record["type"] for record in records}
        if "trial" in kinds:
            rows = selfcheck.summary(records)
            out.print(verdicts.selfcheck_table(rows))
            write_json({"schema": 1, "machine": header["machine"], "results": rows})
            return
        if "verdict" in kinds:
            rows = [record for record in records if record["type"] == "verdict"]
            verdicts.print_table(out, rows)
            for row in rows:
                row.pop("samples")
            write_json({"schema": 1, "machine": header["machine"], "results": rows})
            return
        for group in derive.by_model(records):
            if any(r["type"] == "model" for r in group):
                found += tables.model_report(out, group)
        tables.print_crossovers(out, found)
        write_json(derive.document(header["machine"], found))


@cli.command()
@click.argument("names", nargs=-1, metavar="[MODEL]…")
@LIMIT
@JSON
def models(names: tuple[str, ...], time_limit: float, json_file: str | None) -> None:
    """List models: sizes, contacts and constraints at the start, timestep, integrator, solver."""
    from mjbench.comparison import listing
    from mjbench.report import tables
    from mjbench.simulation import models as room

    sources = [room.resolve(name) for name in names or room.shipped()]
    with output(json_file) as write_json:
        rows = listing.facts(sources, time_limit)
        tables.print_models(tables.console(stderr=json_file == "-"), rows)
        write_json({"schema": 1, "models": rows})
    sys.exit(exit_code(row["status"] for row in rows))


@cli.command()
@JSON
def paths(json_file: str | None) -> None:
    """List the ways of stepping, what they can do, and why one is not available here."""
    from mjbench import paths as room
    from mjbench.report import tables

    rows = [
        {
            "path": path.name,
            "summary": path.summary,
            "closed_loop": path.closed_loop,
            "unavailable": path.unavailable(),
            "options": {option.name: option.summary for option in path.options},
        }
        for path in room.registry().values()
    ]
    with output(json_file) as write_json:
        tables.console(stderr=json_file == "-").print(tables.paths_table(rows))
        write_json({"schema": 1, "paths": rows})


@cli.command()
@click.argument("old", type=click.Path(path_type=Path))
@click.argument("new", type=click.Path(path_type=Path))
@click.option(
    "--across",
    is_flag=True,
    help="Compare also what differs in JAX, jaxlib, XLA flags, device or precision.",
)
@JSON
def diff(old: Path, new: Path, across: bool, json_file: str | None) -> None:
    """Compare the speeds of two run files of `compare`, row by row.

    \b
    They were taken at different times, which no statistics mends: for releases, models and
    options `mjbench versions` and `mjbench ab` alternate both sides instead.
    """
    from mjbench.instrument import runs
    from mjbench.report import results as derive
    from mjbench.report import tables

    with output(json_file) as write_json:
        rows = derive.differences(runs.load(old), runs.load(new), across)
        if not rows:
            raise InputError(f"{old} and {new} have no timed row of `compare` in common")
        out = tables.console(stderr=json_file == "-")
        out.print(tables.differences_table(rows))
        write_json({"schema": 1, "results": rows})
    sys.exit(exit_code(row["status"] for row in rows))
