"""`mjbench results`, and `results merge`: run files of several machines in one run set."""

from pathlib import Path

import click

from mjbench.cli.context import RunContext
from mjbench.cli.group import cli, report_line
from mjbench.cli.shared import FILE, JSON
from mjbench.errors import InputError


@cli.group()
def results() -> None:
    """Merge run files into a set, or write a site of all of them.

    `mjbench show` prints and compares runs, and writes reports and formats of other tools.
    """


@results.command(short_help="merge run files into one, a run set")
@click.argument("files", nargs=-1, required=True, metavar="RUN…", type=FILE)
@click.option(
    "-o",
    "--output",
    required=True,
    metavar="SET",
    type=FILE,
    help="Run set to write. If it exists, runs that it lacks are appended.",
)
@JSON
def merge(files: tuple[Path, ...], output: Path, json_file: str | None) -> None:
    """Merge run files of one or several machines into one file, a run set.

    The set has every run once, unchanged. Sets can be merged, too. `show`, `history`
    and mjbench.load read sets like run files. They tell machines apart by the environment
    variable MJBENCH_MACHINE of the command that measured, otherwise by a hash of the host.

    \b
    Example:
      mjbench results merge runs-*/*.jsonl -o all.jsonl
      mjbench show all.jsonl --html
    """
    from mjbench.report.documents import MergeDocument
    from mjbench.report.kinds import RECORD_TYPES
    from mjbench.store import run_set

    if str(output) == "-":
        raise InputError("a run set cannot go to standard output: give -o FILE")
    with RunContext(json_file, [*files, output]) as run:
        merged = run_set.merge(files, output, RECORD_TYPES)
        for path in merged.torn:
            report_line(f"{path}: its end was cut short; the incomplete part is left out")
        document = MergeDocument.of(output, merged)
        run.out.print(f"{output}: {document.summary}", soft_wrap=True)
        run.write(document)
