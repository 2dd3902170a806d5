"""`mjbench latency`: how long single steps take, and which are late."""

from pathlib import Path

import click

from mjbench.cli.context import RunContext, Storage
from mjbench.cli.each_model import measure_or_report
from mjbench.cli.group import cli
from mjbench.cli.shared import (
    COUNT,
    HOLD,
    JSON,
    LIMIT,
    RESULTS,
    SEED,
    STARTS,
    WAIT,
    Hertz,
    Seconds,
    start_plan,
    with_options,
)
from mjbench.errors import Failure


@cli.command()
@click.argument("names", nargs=-1, required=True, metavar="MODEL…")
@click.option(
    "--deadline",
    "deadline_s",
    type=Seconds(),
    help="Time by which a step should end  [default: the time between two paced steps;"
    " free-running, the model's timestep]",
)
@click.option(
    "--rate",
    "rate_hz",
    type=Hertz(),
    help="Paced steps per second  [default: real time]",
)
@click.option(
    "--nstep", type=COUNT, help="Steps at each pace  [default: 10,000, or what 10s allow]"
)
@with_options(HOLD, SEED, *STARTS, LIMIT, RESULTS, WAIT, JSON)
def latency(
    names: tuple[str, ...],
    deadline_s: float | None,
    rate_hz: float | None,
    nstep: int | None,
    hold: int,
    seed: int,
    settle_s: float | None,
    states_file: Path | None,
    actions_file: Path | None,
    time_limit: float,
    results: Path,
    wait: bool,
    json_file: str | None,
) -> None:
    """How long do single steps take, which miss their deadline, and what do slow ones share?

    Steps are measured free-running, each after the other, and paced: due at a fixed rate, as in a
    controller.

    \b
    Examples:
      mjbench latency humanoid
      mjbench latency robot.xml --rate 1000 --deadline 500us
    """
    from mjbench.loop.latency import LatencyRequest, LatencyRow, measure, row
    from mjbench.report.kinds import LATENCY
    from mjbench.report.latency import sections
    from mjbench.simulation import models

    sources = [models.resolve(name) for name in names]
    plan = start_plan(settle_s, states_file, actions_file)
    files = [*(source.path for source in sources), *plan.files]
    rows: list[LatencyRow] = []
    arguments = {
        "models": [source.name for source in sources],
        "nstep": nstep,
        "rate_hz": rate_hz,
        "deadline_s": deadline_s,
        "hold": hold,
        "seed": seed,
        "starts": plan,
    }
    storage = Storage(results, arguments)
    with RunContext("latency", json_file, files, storage, wait) as run:
        for source in sources:
            samples = measure_or_report(
                source,
                lambda s: measure(LatencyRequest(s, nstep, rate_hz, hold, seed, plan), time_limit),
            )
            if isinstance(samples, Failure):
                measured = [LatencyRow.failed(source.name, samples)]
            else:
                measured = [row(source.name, of_pace, deadline_s) for of_pace in samples]
                run.show(sections(measured))
            rows += measured
            for each in measured:
                run.record(each)
        run.write(LATENCY.document_type(machine=run.machine, results=rows))
    run.exit(each.status for each in rows)
