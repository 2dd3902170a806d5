"""`mjbench merge`: run files of several machines in one run set."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from mjbench.cli.context import RunContext
from mjbench.cli.group import cli, report_line
from mjbench.errors import InputError

if TYPE_CHECKING:
    from mjbench.instrument.merge import Merged


@cli.command()
@click.argument("files", nargs=-1, required=True, metavar="RUN…", type=click.Path(path_type=Path))
@click.option(
    "-o",
    "--output",
    required=True,
    metavar="SET",
    type=click.Path(path_type=Path),
    help="The run set. Runs that it lacks are appended; nothing else in it changes.",
)
def merge(files: tuple[Path, ...], output: Path) -> None:
    """Merge run files and sets, of one or several machines, into one run set.

    Every run is there once, as its run file has it. `report`, `show`, `diff`, `history` and
    mjbench.load read sets, too, and tell machines apart: by the name in the environment variable
    MJBENCH_MACHINE when they measured, else by a hash of the host.

    \b
    Example:
      mjbench merge runs-*/*.jsonl -o all.jsonl
      mjbench report all.jsonl
    """
    from mjbench.instrument.merge import merge as merge_files
    from mjbench.report.documents import RECORD_TYPES

    if str(output) == "-":
        raise InputError("a run set is a file: give -o FILE")
    with RunContext("merge", inputs=files) as run:
        merged = merge_files(files, output, RECORD_TYPES)
        for path in merged.torn:
            report_line(f"{path}: its end was cut short; it is left out")
        run.out.print(f"{output}: {_summary(merged)}", soft_wrap=True)


def _summary(merged: "Merged") -> str:
    """Return what a set holds now, and what was skipped, in one line."""
    from mjbench.instrument.machine_identity import identify

    machines = dict.fromkeys(identify([run.header.machine for run in merged.runs]))
    skipped = [
        f"{count} {why}"
        for count, why in (
            (merged.repeated, "that it holds already"),
            (merged.earlier, "of which it holds a later state"),
        )
        if count
    ]
    end = f", skipped {' and '.join(skipped)}" if skipped else ""
    return (
        f"{_count(len(merged.runs), 'run')} of {_count(len(machines), 'machine')};"
        f" added {merged.added}{end}"
    )


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"
