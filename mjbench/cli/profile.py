"""`mjbench profile`: where a step's time goes."""

from pathlib import Path

import click

from mjbench.cli.context import RunContext, Storage
from mjbench.cli.each_model import measure_or_report
from mjbench.cli.group import cli
from mjbench.cli.shared import JSON, LIMIT, RESULTS, SETTLE, STATES, WAIT, start_plan, with_options
from mjbench.errors import Failure


@cli.command()
@click.argument("names", nargs=-1, required=True, metavar="MODEL…")
@with_options(SETTLE, STATES, LIMIT, RESULTS, WAIT, JSON)
def profile(
    names: tuple[str, ...],
    settle_s: float | None,
    states_file: Path | None,
    time_limit: float,
    results: Path,
    wait: bool,
    json_file: str | None,
) -> None:
    """Where does a step's time go: engine stages, Python around it, rendering?

    Stages are from MuJoCo's own timers. Rendering is timed with EGL and with OSMesa, or on macOS
    with CGL. Steps are short runs from states along the model's own run, or from those of --states,
    each with its controls held.

    \b
    Examples:
      mjbench profile humanoid
      mjbench profile robot.mjb --states states.npz
    """
    from mjbench.loop.profile import ProfileRow, measure
    from mjbench.report.kinds import PROFILE
    from mjbench.report.profile import sections
    from mjbench.simulation import models

    sources = [models.resolve(name) for name in names]
    starts = start_plan(settle_s, states_file)
    files = [*(source.path for source in sources), *starts.files]
    rows: list[ProfileRow] = []
    arguments = {"models": [source.name for source in sources], "starts": starts}
    storage = Storage(results, arguments)
    with RunContext("profile", json_file, files, storage, wait) as run:
        for source in sources:
            step_profile = measure_or_report(
                source, lambda source: measure(source, time_limit, starts)
            )
            if isinstance(step_profile, Failure):
                rows.append(ProfileRow.failed(source.name, step_profile))
            else:
                rows.append(ProfileRow.measured(step_profile))
                run.show(sections(rows[-1:]))
            run.record(rows[-1])
        run.write(PROFILE.document_type(machine=run.machine, results=rows))
    run.exit(row.status for row in rows)
