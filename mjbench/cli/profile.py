"""`mjbench profile`: where a step's time goes."""

from typing import Any

import click

from mjbench.cli.each_model import measure_each
from mjbench.cli.group import cli
from mjbench.cli.shared import JSON, LIMIT, RESULTS, SETTLE, STATES, WAIT, with_options


@cli.command()
@click.argument("names", nargs=-1, required=True, metavar="MODEL…")
@with_options(SETTLE, STATES, LIMIT, RESULTS, WAIT, JSON)
def profile(names: tuple[str, ...], **options: Any) -> None:
    """Where does a step's time go: engine stages, Python around it, rendering?

    Stages are from MuJoCo's own timers. Rendering is timed with EGL and with OSMesa, or on macOS
    with CGL. Steps are short runs from states along the model's own run, or from those of --states,
    each with its controls held.

    \b
    Examples:
      mjbench profile humanoid
      mjbench profile robot.mjb --states states.npz
    """
    from mjbench.loop.profile import measure
    from mjbench.report.kinds import PROFILE

    measure_each(
        names,
        PROFILE,
        lambda source, starts, limit_s: [measure(source, limit_s, starts)],
        **options,
    )
