"""`mjbench latency`: how long single steps take, and which are late."""

from typing import Any

import click

from mjbench.cli.each_model import measure_each
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
    with_options,
)


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
    **options: Any,
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
    from mjbench.simulation.models import ModelSource
    from mjbench.simulation.starts import StartPlan

    def rows(source: ModelSource, starts: StartPlan, limit_s: float) -> list[LatencyRow]:
        samples = measure(LatencyRequest(source, nstep, rate_hz, hold, seed, starts), limit_s)
        return [row(source.name, of_pace, deadline_s) for of_pace in samples]

    arguments = {"nstep": nstep, "rate_hz": rate_hz, "deadline_s": deadline_s, "hold": hold}
    measure_each(
        names,
        LATENCY,
        rows,
        {**arguments, "seed": seed},
        **options,
    )
