"""`mjbench diff`: two run files of `compare`."""

from pathlib import Path

import click

from mjbench.cli.context import RunContext
from mjbench.cli.group import cli
from mjbench.cli.shared import JSON
from mjbench.errors import InputError


@cli.command()
@click.argument("old", type=click.Path(path_type=Path))
@click.argument("new", type=click.Path(path_type=Path))
@click.option(
    "--across",
    is_flag=True,
    help="Compare even where JAX, jaxlib, XLA flags, device or precision differ.",
)
@JSON
def diff(old: Path, new: Path, across: bool, json_file: str | None) -> None:
    """Compare the speeds of two run files of `compare`, row by row.

    The two were measured at different times, which no statistics can correct. For releases,
    models and options, `mjbench versions` and `mjbench ab` alternate both targets instead.

    \b
    Example:
      mjbench diff old.jsonl new.jsonl
    """
    from mjbench.instrument import runs
    from mjbench.report.comparison import differences_table
    from mjbench.report.documents import RECORD_TYPES, DiffDocument
    from mjbench.report.run_differences import run_differences

    with RunContext("diff", json_file, inputs=[old, new]) as run:
        rows = run_differences(runs.load(old, RECORD_TYPES), runs.load(new, RECORD_TYPES), across)
        if not rows:
            raise InputError(f"{old} and {new} have no timed row of `compare` in common")
        run.out.print(differences_table(rows))
        run.write(DiffDocument(results=rows))
    run.exit(row.status for row in rows)
