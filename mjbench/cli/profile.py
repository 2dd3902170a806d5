"""`mjbench profile`: where a step's time goes."""

from pathlib import Path

import click

from mjbench.cli.context import RunContext, Storage
from mjbench.cli.each_model import measure_or_report
from mjbench.cli.group import cli
from mjbench.cli.shared import JSON, LIMIT, RESULTS, WAIT, with_options
from mjbench.errors import Failure


@cli.command()
@click.argument("names", nargs=-1, required=True, metavar="MODEL…")
@with_options(LIMIT, RESULTS, WAIT, JSON)
def profile(
    names: tuple[str, ...], time_limit: float, results: Path, wait: bool, json_file: str | None
) -> None:
    """Where does a step's time go: engine stages, Python around it, rendering?

    Stages are from MuJoCo's own timers. Rendering is timed with EGL and with OSMesa, or on macOS
    with CGL.

    \b
    Example:
      mjbench profile humanoid
    """
    from mjbench.loop.profile import ProfileRow, measure
    from mjbench.report.documents import ProfileDocument
    from mjbench.report.profile import print_profile
    from mjbench.simulation import models

    sources = [models.resolve(name) for name in names]
    files = [source.path for source in sources]
    rows: list[ProfileRow] = []
    storage = Storage(results, {"models": [source.name for source in sources]})
    with RunContext("profile", json_file, files, storage, wait) as run:
        for source in sources:
            step_profile = measure_or_report(source, lambda source: measure(source, time_limit))
            if isinstance(step_profile, Failure):
                rows.append(ProfileRow.failed(source.name, step_profile))
            else:
                rows.append(ProfileRow.measured(step_profile))
                print_profile(run.out, step_profile)
            run.record(rows[-1])
        run.write(ProfileDocument(machine=run.machine, results=rows))
    run.exit(row.status for row in rows)
