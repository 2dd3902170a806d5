"""`mjbench profile`: where a step's time goes."""

import click

from mjbench.cli.context import RunContext
from mjbench.cli.each_model import measure_or_report
from mjbench.cli.group import cli
from mjbench.cli.shared import JSON, LIMIT, WAIT, with_options
from mjbench.errors import Failure


@cli.command()
@click.argument("names", nargs=-1, required=True, metavar="MODEL…")
@with_options(LIMIT, WAIT, JSON)
def profile(names: tuple[str, ...], time_limit: float, wait: bool, json_file: str | None) -> None:
    """Where does a step's time go: engine stages, Python around it, rendering?

    Stages are from MuJoCo's own timers. Rendering is timed with EGL and with OSMesa, or on macOS
    with CGL.
    """
    from mjbench.loop.profile import ProfileRow, measure
    from mjbench.report.documents import ProfileDocument
    from mjbench.report.profile import print_profile
    from mjbench.simulation import models

    sources = [models.resolve(name) for name in names]
    files = [source.path for source in sources]
    rows = []
    with RunContext("profile", json_file, files, wait=wait) as run:
        for source in sources:
            step_profile = measure_or_report(source, lambda source: measure(source, time_limit))
            if isinstance(step_profile, Failure):
                rows.append(ProfileRow.failed(source.name, step_profile))
                continue
            print_profile(run.out, step_profile)
            rows.append(ProfileRow.measured(step_profile))
        run.write(ProfileDocument(machine=run.machine, results=rows))
    run.exit(row.status for row in rows)
