"""`mjbench overhead`: what the habits of a Python loop cost."""

import sys

import click

from mjbench.cli.each_model import measure_or_report
from mjbench.cli.group import cli
from mjbench.cli.shared import JSON, LIMIT, output
from mjbench.errors import Failure
from mjbench.status import exit_code


@cli.command()
@click.argument("names", nargs=-1, metavar="[MODEL]…")
@click.option("--code", is_flag=True, help="Print each habit's loop, and its cheaper form.")
@LIMIT
@JSON
def overhead(names: tuple[str, ...], code: bool, time_limit: float, json_file: str | None) -> None:
    """What does each habit of a Python loop cost beside mj_step, and what is cheaper?

    MODEL is cartpole unless named. Every habit is timed inside a stepping loop, in turns with the
    bare loop, in several processes.
    """
    from mjbench.instrument import machine, runs
    from mjbench.loop.overhead import OverheadRow, measure
    from mjbench.report import tables
    from mjbench.report.overhead import print_table
    from mjbench.simulation import models

    sources = [models.resolve(name) for name in names or ("cartpole",)]
    out = tables.console(stderr=json_file == "-")
    rows = []
    with output(json_file) as write_json:
        for source in sources:
            table = measure_or_report(source, lambda source: measure(source, time_limit))
            if isinstance(table, Failure):
                rows.append(OverheadRow.failed(source.name, table))
                continue
            print_table(out, table, code)
            rows.append(OverheadRow.measured(table))
        document = {"schema": runs.SCHEMA, "machine": machine.describe(), "results": rows}
        write_json(runs.to_json(document))
    sys.exit(exit_code(row.status for row in rows))
