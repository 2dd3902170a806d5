"""`mjbench profile`: where a step's time goes."""

import sys

import click

from mjbench.cli.each_model import measure_or_report
from mjbench.cli.group import cli
from mjbench.cli.shared import JSON, LIMIT, output
from mjbench.errors import Failure
from mjbench.status import exit_code


@cli.command()
@click.argument("names", nargs=-1, required=True, metavar="MODEL…")
@LIMIT
@JSON
def profile(names: tuple[str, ...], time_limit: float, json_file: str | None) -> None:
    """Where does a step's time go: engine stages, Python around it, rendering?

    Stages are MuJoCo's own timers. Rendering is tried by EGL and OSMesa.
    """
    from mjbench.instrument import machine, runs
    from mjbench.loop.profile import ProfileRow, measure
    from mjbench.report import tables
    from mjbench.report.profile import print_profile
    from mjbench.simulation import models

    sources = [models.resolve(name) for name in names]
    out = tables.console(stderr=json_file == "-")
    rows = []
    with output(json_file) as write_json:
        for source in sources:
            step_profile = measure_or_report(source, lambda source: measure(source, time_limit))
            if isinstance(step_profile, Failure):
                rows.append(ProfileRow.failed(source.name, step_profile))
                continue
            print_profile(out, step_profile)
            rows.append(ProfileRow.measured(step_profile))
        document = {"schema": runs.SCHEMA, "machine": machine.describe(), "results": rows}
        write_json(runs.to_json(document))
    sys.exit(exit_code(row.status for row in rows))
