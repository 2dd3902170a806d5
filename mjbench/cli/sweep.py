"""`mjbench sweep`: a command for each combination of values, on the nodes of a Ray cluster."""

import contextlib
from collections.abc import Generator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mjbench.cli.context import RunContext
from mjbench.cli.group import cli, command_line
from mjbench.cli.shared import FILE, takes
from mjbench.commands.sweep.options import SweepOptions
from mjbench.errors import InputError, MjbenchError, writing

if TYPE_CHECKING:
    from mjbench.commands.show.documents import SweepRow
    from mjbench.commands.sweep.ray_cluster import Cell, CellResult, Plan
    from mjbench.results.content import Section

# In which folder each plan has one for its run files, unless --results says otherwise.
SWEEPS_FOLDER = Path("results/sweeps")


@cli.command()
@click.argument("plan", metavar="PLAN.toml", type=FILE)
@takes(SweepOptions)
def sweep(plan: Path, options: SweepOptions) -> None:
    """Run the command of PLAN.toml for each combination of its values, on a Ray cluster.

    Each result is a run file, stored as soon as it arrives. A node runs one command at a time. If
    it dies, another one does its work. After an interruption, or with a longer plan, give the same
    command again: it measures only what is missing.

    It needs the extra `ray`.

    \b
    Example of a plan:
      command = "versions 3.3.0 {release} {model}"
      [matrix]
      model = ["humanoid", "robot.xml"]
      release = ["3.17.0", "4.0.0"]

    \b
    Examples:
      mjbench sweep plan.toml --dry-run
      mjbench sweep plan.toml
      mjbench sweep plan.toml --address auto
    """
    from mjbench.commands.show import forms
    from mjbench.commands.show.documents import SweepRow
    from mjbench.commands.sweep import ray_cluster as sweeps
    from mjbench.results.json_form import ResultsDocument

    target = options.results or SWEEPS_FOLDER / plan.stem
    with RunContext(options, [plan]) as run:
        loaded, cells = sweeps.load(plan, check_command)
        files = {cell: target / cell.file_name for cell in cells}
        ended: dict[Cell, CellResult] = {}
        missing = [] if options.dry_run else [cell for cell in cells if not files[cell].is_file()]
        try:
            results = _measure(run, missing, loaded, plan.absolute().parent, options.address)
            with contextlib.closing(results):
                for cell, ended[cell] in results:
                    if ended[cell].content:
                        _store(files[cell], ended[cell].content)
        except KeyboardInterrupt:
            run.interrupt(is_saved=any(map(Path.is_file, files.values())))
        rows = [SweepRow.of(cell, files[cell], ended.get(cell)) for cell in cells]
        run.show([_section(rows)])
        run.write_forms(
            forms.of_sections(command_line(), [_section(rows)], ResultsDocument(results=rows), rows)
        )
        run.out.print(f"\nRun files: {target}", soft_wrap=True)
        run.exit(result.status for result in ended.values())


def _measure(
    run: RunContext, cells: "Sequence[Cell]", plan: "Plan", folder: Path, address: str | None
) -> "Generator[tuple[Cell, CellResult], None, None]":
    """Yield the result of each cell as it ends; nothing starts where none is missing."""
    from mjbench.cli.progress import progress
    from mjbench.commands.sweep import ray_cluster as sweeps

    here = folder / plan.folder
    if cells:
        with (
            progress(run.out) as on_progress,
            sweeps.cluster(address, here if address and plan.folder else None),
        ):
            results = sweeps.measure(cells, plan.retries, None if address else here)
            for number, (cell, result) in enumerate(results, 1):
                yield cell, result
                on_progress(f"{number} of {len(cells)} results", number / len(cells))


def _store(file: Path, content: bytes) -> None:
    from mjbench.host import files

    with writing(file), files.replacing(file) as partial:
        partial.write_bytes(content)


def _section(rows: "Sequence[SweepRow]") -> "Section":
    """Return a table with a row for each cell: what its run file comes to, or why there is none."""
    from mjbench.formats import count_of
    from mjbench.results.content import Column, Conclusion, DataTable, Section

    table = DataTable.of(
        "Results",
        rows,
        (Column("command"), lambda row: row.command.removeprefix("mjbench ")),
        (Column("machine"), lambda row: row.machine or None),
        (Column("result", wraps=True), _result),
    )
    missing = sum(row.file is None for row in rows)
    text = f"{count_of(len(rows), 'result')}, {missing} of them missing"
    return Section("Results", [Conclusion(text)], tables=[table])


def _result(row: "SweepRow") -> str:
    from mjbench.commands.show import kinds
    from mjbench.results import runs
    from mjbench.results.content import Tone

    if row.file is None:
        return f"{row.status}: {row.detail}" if row.status else "missing"
    try:
        run = runs.load(Path(row.file), kinds.RECORD_TYPES)
    except MjbenchError as error:
        return str(error)
    conclusions = [c for section in kinds.kind_of(run).sections(run) for c in section.conclusions]
    conclusions.sort(key=lambda conclusion: conclusion.tone == Tone.CAUTION)  # what disturbed it
    return conclusions[0].text if conclusions else "no result"


def check_command(words: Sequence[str]) -> None:
    """Parse a command line of mjbench without running it; raises InputError if it is wrong."""
    try:
        _, command, rest = cli.resolve_command(click.Context(cli), list(words))
        assert command is not None
        command.make_context(command.name, rest)
    except click.UsageError as error:
        raise InputError(error.format_message()) from None
    if {"resume", "wait"}.isdisjoint(parameter.name or "" for parameter in command.params):
        raise InputError("this command stores no results")
