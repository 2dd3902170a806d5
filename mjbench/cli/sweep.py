"""`mjbench sweep`: a matrix of models, releases, paths and machines, on the nodes of a cluster."""

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mjbench.cli.context import RunContext
from mjbench.cli.group import cli, command_line, report_line
from mjbench.cli.shared import FILE, JSON, check_sizes
from mjbench.errors import InputError, MachineError

if TYPE_CHECKING:
    from mjbench.api.sweep import Swept
    from mjbench.sweep.matrix import Matrix

# Where run sets of sweeps are stored unless -o says otherwise.
SWEEPS_FOLDER = Path("results/sweeps")


@cli.command()
@click.argument("plan", metavar="PLAN.toml", type=FILE)
@click.option(
    "--address",
    metavar="HOST:PORT|auto",
    help="Ray cluster to measure on; `auto` is the one that this machine belongs to"
    "  [default: this machine alone]",
)
@click.option(
    "-o",
    "--output",
    metavar="SET.jsonl",
    type=FILE,
    help="Run set to write; what it already has is not measured again"
    "  [default: results/sweeps/PLAN.jsonl]",
)
@click.option("--dry-run", is_flag=True, help="Print what would be measured; measure nothing.")
@click.option(
    "--retry",
    is_flag=True,
    help="Also measure again what failed; the earlier failures stay in the run set.",
)
@JSON
def sweep(
    plan: Path,
    address: str | None,
    output: Path | None,
    dry_run: bool,
    retry: bool,
    json_file: str | None,
) -> None:
    """Measure what PLAN.toml asks for on all nodes of a Ray cluster, each result once.

    The plan names models, releases, paths, metrics and machines. A node measures time only if its
    machine is quiet. Results are stored as soon as they are complete. If a node dies, another one
    does its work. After an interruption, or with a longer plan, give the same command again: it
    measures only what is missing.

    It needs the extra `ray`.

    \b
    Example of a plan:
      models = ["humanoid", "robot.xml"]
      releases = ["3.3.0", "3.17.0", "4.0.0"]

    \b
    Examples:
      mjbench sweep plan.toml --dry-run
      mjbench sweep plan.toml
      mjbench sweep plan.toml --address auto
    """
    from mjbench.api import sweep as sweeps
    from mjbench.cli.progress import progress
    from mjbench.report import sweep as report
    from mjbench.report.documents import SweepDocument
    from mjbench.sweep import matrix, software
    from mjbench.sweep import plan as plans

    target = output or SWEEPS_FOLDER / f"{plan.stem}.jsonl"
    with RunContext(json_file, [plan, target]) as run:
        cells = matrix.build(plans.load(plan, check_command), software.installed())
        if dry_run:
            stored = sweeps.stored(target, cells)
            words = [word for word in command_line() if word != "--dry-run"]
            command = shlex.join(["mjbench", *words])
            run.show([report.cells_section(cells.cells, stored, command)])
            run.write(SweepDocument.of(cells.cells, stored))
            return
        swept = sweeps.measure_missing(
            cells, target, address, retry, lambda: progress(run.out), report_line
        )
        run.show([report.section(swept.outcomes, swept.summary)])
        run.write(SweepDocument.of(cells.cells, swept.outcomes))
        run.out.print(f"\nRun set: {target}", soft_wrap=True)
        run.out.print(f"Report: mjbench show {target} --html", soft_wrap=True)
        _end(run, cells, swept)


def _end(run: RunContext, matrix: "Matrix", swept: "Swept") -> None:
    """End with the exit code of the results, or say why some are missing."""
    summary = swept.summary
    if summary and summary.is_interrupted:
        run.interrupt(is_saved=True)
    elif summary and summary.missing:
        reasons = "; ".join(summary.reasons)
        raise MachineError(
            f"{len(summary.missing)} of {len(matrix.cells)} results are missing: {reasons}"
        )
    run.exit(outcome.status for outcome in swept.outcomes.values())


def check_command(arguments: Sequence[str]) -> None:
    """Parse a command line of mjbench without running it; raises InputError if it is wrong."""
    command: click.Command = cli
    rest = list(arguments)
    while isinstance(command, click.Group):
        name, subcommand, rest = command.resolve_command(click.Context(command), rest)
        assert subcommand is not None, name
        command = subcommand
    try:
        with command.make_context(command.name, rest) as context:
            values = context.params
    except click.BadParameter as error:
        raise InputError(error.message) from None
    except click.UsageError as error:
        raise InputError(error.format_message()) from None
    check_sizes(values.get("nstep"), values.get("hold") or 1)
