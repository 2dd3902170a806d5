"""`mjbench overhead`: what the habits of a Python loop cost."""

from pathlib import Path

import click

from mjbench.cli.context import RunContext, Storage
from mjbench.cli.each_model import measure_or_report
from mjbench.cli.group import cli
from mjbench.cli.shared import JSON, LIMIT, RESULTS, SETTLE, STATES, WAIT, start_plan, with_options
from mjbench.errors import Failure


@cli.command()
@click.argument("names", nargs=-1, metavar="[MODEL]…")
@click.option("--code", is_flag=True, help="Print each habit's loop, and its cheaper form.")
@with_options(SETTLE, STATES, LIMIT, RESULTS, WAIT, JSON)
def overhead(
    names: tuple[str, ...],
    code: bool,
    settle_s: float | None,
    states_file: Path | None,
    time_limit: float,
    results: Path,
    wait: bool,
    json_file: str | None,
) -> None:
    """What does each habit of a Python loop cost beside mj_step, and what is cheaper?

    Every habit is timed inside a stepping loop, in turns with the bare loop, in several processes.
    Loops start from states along the model's own run, or from those of --states, and hold their
    controls.
    Without a MODEL: cartpole.

    \b
    Examples:
      mjbench overhead cartpole
      mjbench overhead robot.mjb --states states.npz
    """
    from mjbench.loop.overhead import OverheadRow, measure
    from mjbench.report.kinds import OVERHEAD
    from mjbench.report.overhead import sections
    from mjbench.simulation import models

    sources = [models.resolve(name) for name in names or ("cartpole",)]
    starts = start_plan(settle_s, states_file)
    files = [*(source.path for source in sources), *starts.files]
    rows: list[OverheadRow] = []
    arguments = {"models": [source.name for source in sources], "starts": starts}
    storage = Storage(results, arguments)
    with RunContext("overhead", json_file, files, storage, wait) as run:
        for source in sources:
            table = measure_or_report(
                source, lambda source: measure(source, time_limit, starts=starts)
            )
            if isinstance(table, Failure):
                rows.append(OverheadRow.failed(source.name, table))
            else:
                rows.append(OverheadRow.measured(table))
                run.show(sections(rows[-1:]), code)
            run.record(rows[-1])
        run.write(OVERHEAD.document_type(machine=run.machine, results=rows))
    run.exit(row.status for row in rows)
