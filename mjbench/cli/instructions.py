"""`mjbench instructions`: instructions per step, counted by Callgrind."""

from pathlib import Path

import click

from mjbench.cli.context import RunContext, Storage
from mjbench.cli.group import cli
from mjbench.cli.shared import (
    COUNT,
    JSON,
    RESULTS,
    SIZES,
    Seconds,
    check_sizes,
    start_plan,
    with_options,
)


@cli.command()
@click.argument("names", nargs=-1, metavar="[MODEL]…")
@click.option(
    "--release",
    "releases",
    multiple=True,
    metavar="RELEASE",
    help="Release to count in; may be given several times.  [default: installed]",
)
@click.option(
    "--top",
    type=COUNT,
    default=10,
    show_default=True,
    help="List this many functions.",
)
@click.option(
    "--time-limit",
    "limit_s",
    type=Seconds(),
    default="600s",
    show_default=True,
    help="Kill a release's process that finishes no model for this long.",
)
@with_options(*SIZES, RESULTS, JSON)
def instructions(
    names: tuple[str, ...],
    releases: tuple[str, ...],
    top: int,
    limit_s: float,
    nbatch: int | None,
    nstep: int | None,
    hold: int,
    seed: int,
    settle_s: float | None,
    states_file: Path | None,
    actions_file: Path | None,
    results: Path,
    json_file: str | None,
) -> None:
    """Count instructions per step, by function and stage; within 0.1 % the same on a busy machine.

    Needs valgrind. The first RELEASE draws start states and controls; every other one does the same
    work. Without a MODEL: all shipped models.

    \b
    Example:
      mjbench instructions humanoid --release 3.3.0 --release 4.0.0
    """
    from mjbench.counts.instructions import InstructionCounter, ModelCount
    from mjbench.paired.run_sizes import Sizes
    from mjbench.releases import installs
    from mjbench.report import counts
    from mjbench.report.kinds import INSTRUCTIONS
    from mjbench.simulation import models

    check_sizes(nstep, hold)
    starts = start_plan(settle_s, states_file, actions_file)
    sources = [models.resolve(name) for name in names or models.shipped()]
    specs = [installs.parse_release(name) for name in releases or (installs.INSTALLED,)]
    files = [source.path for source in sources] + [wheel for s in specs for wheel in s.wheels]
    files += starts.files
    sizes = Sizes(nbatch, nstep, hold, seed, starts)
    arguments = {
        "sizes": sizes,
        "releases": [spec.key for spec in specs],
        "models": [source.name for source in sources],
    }
    model_counts: list[ModelCount] = []
    with (
        InstructionCounter(sizes) as counter,
        RunContext("instructions", json_file, files, Storage(results, arguments)) as run,
    ):
        with run.progress(len(specs)) as advance:
            for number, spec in enumerate(specs):
                advance(number, f"MuJoCo {spec.version}", 0.0)
                counted = counter.count(spec, sources, limit_s)
                for count in counted:
                    run.record(count.record())
                model_counts += counted
        records = [count.record() for count in model_counts]
        run.show(counts.sections(records, top))
        run.write(INSTRUCTIONS.document_type(results=records))
    run.exit(count.status for count in model_counts)
