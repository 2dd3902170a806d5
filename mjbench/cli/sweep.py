"""`mjbench sweep`: a matrix of models, releases, paths and machines, on the nodes of a cluster."""

import contextlib
import itertools
import os
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mjbench.cli.context import RunContext
from mjbench.cli.group import cli, command_line, report_line
from mjbench.cli.shared import FILE, JSON, check_sizes
from mjbench.errors import InputError, MachineError
from mjbench.status import FINISHED

if TYPE_CHECKING:
    from mjbench.store.run_set import RunSetFile
    from mjbench.sweep.cells import Cell
    from mjbench.sweep.matrix import Matrix
    from mjbench.sweep.results import CellOutcome, CellResult
    from mjbench.sweep.run import Summary

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
    from mjbench.report import sweep as report
    from mjbench.report.documents import SweepDocument
    from mjbench.sweep import matrix, software
    from mjbench.sweep import plan as plans

    target = output or SWEEPS_FOLDER / f"{plan.stem}.jsonl"
    with RunContext(json_file, [plan, target]) as run:
        cells = matrix.build(plans.load(plan, check_command), software.installed())
        if dry_run:
            stored = _stored(target, cells)
            words = [word for word in command_line() if word != "--dry-run"]
            command = shlex.join(["mjbench", *words])
            run.show([report.cells_section(cells.cells, stored, command)])
            run.write(SweepDocument.of(cells.cells, stored))
            return
        _sweep(run, cells, target, address, retry)


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


def _sweep(
    run: RunContext, matrix: "Matrix", target: Path, address: str | None, retry: bool
) -> None:
    from mjbench.report import sweep as report
    from mjbench.report.content import Conclusion, Section
    from mjbench.report.documents import SweepDocument

    with contextlib.ExitStack() as on_error, contextlib.closing(_open(target, on_error)) as file:
        stored = _stored(target, matrix)
        done = [cell for cell, how in stored.items() if not retry or how.status in FINISHED]
        if len(done) == len(matrix.cells):
            text = "The run set has all results of the plan; nothing was measured."
            run.show([Section("Results", [Conclusion(text), *report.failures(stored)])])
            summary = None
        else:
            summary = _measure(run, matrix, done, file, address)
            on_error.pop_all()
            stored |= summary.outcomes
            run.show([report.summary_section(summary, stored)])
    run.write(SweepDocument.of(matrix.cells, stored))
    run.out.print(f"\nRun set: {target}", soft_wrap=True)
    run.out.print(f"Report: mjbench show {target} --html", soft_wrap=True)
    if summary and summary.is_interrupted:
        run.interrupt(is_saved=True)
    elif summary and summary.missing:
        reasons = "; ".join(summary.reasons)
        raise MachineError(
            f"{len(summary.missing)} of {len(matrix.cells)} results are missing: {reasons}"
        )
    run.exit(outcome.status for outcome in stored.values())


def _measure(
    run: RunContext,
    matrix: "Matrix",
    done: "Sequence[Cell]",
    file: "RunSetFile",
    address: str | None,
) -> "Summary":
    from mjbench.cli.progress import progress
    from mjbench.sweep.ray_cluster import RayCluster
    from mjbench.sweep.run import Sweep

    count = len(matrix.cells)
    with progress(run.out) as observer, RayCluster(address, matrix.plan.rules.tries) as cluster:
        for left_out in cluster.left_out:
            report_line(f"{left_out.name} is left out: {left_out.reason}")

        def on_result(result: "CellResult", node: str, ndone: int) -> None:
            file.append(result.section)
            text = f"{ndone} of {count} results; {result.cell.name} from {node}"
            observer(text, ndone / count)

        return Sweep(matrix, done, cluster, on_result).measure()


def _open(target: Path, on_error: contextlib.ExitStack) -> "RunSetFile":
    from mjbench.errors import writing
    from mjbench.store.run_set import RunSetFile

    # not Path.exists, which fails where a name is too long; create has a message for that
    if os.path.lexists(target):
        return RunSetFile.open(target)
    with writing(target):
        target.parent.mkdir(parents=True, exist_ok=True)
    file = RunSetFile.create(target)
    on_error.callback(_remove_empty, target)
    return file


def _remove_empty(target: Path) -> None:
    """Remove a run set that has no section: nothing began to measure."""
    with contextlib.suppress(OSError):
        with target.open("rb") as file:
            lines = list(itertools.islice(file, 2))
        if len(lines) < 2:
            target.unlink()


def _stored(target: Path, matrix: "Matrix") -> "dict[Cell, CellOutcome]":
    """Return how the cells in a run set ended; the last result of each counts."""
    from mjbench.report.kinds import RECORD_TYPES
    from mjbench.store import run_set
    from mjbench.sweep import results

    if not os.path.lexists(target):
        return {}
    sections = run_set.read(target, RECORD_TYPES).sections
    by_key = {section.cell: section.run for section in sections if section.cell}
    return {cell: results.outcome(by_key[cell.key]) for cell in matrix.cells if cell.key in by_key}
