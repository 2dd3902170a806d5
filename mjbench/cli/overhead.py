"""`mjbench overhead`: what the habits of a Python loop cost."""

from typing import Any

import click

from mjbench.cli.each_model import measure_each
from mjbench.cli.group import cli
from mjbench.cli.shared import JSON, LIMIT, RESULTS, SETTLE, STATES, WAIT, with_options


@cli.command()
@click.argument("names", nargs=-1, metavar="[MODEL]…")
@click.option("--code", is_flag=True, help="Print each habit's loop, and its cheaper form.")
@with_options(SETTLE, STATES, LIMIT, RESULTS, WAIT, JSON)
def overhead(names: tuple[str, ...], code: bool, **options: Any) -> None:
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
    from mjbench.loop.overhead import measure
    from mjbench.report.kinds import OVERHEAD

    measure_each(
        names or ("cartpole",),
        OVERHEAD,
        lambda source, starts, limit_s: [measure(source, limit_s, starts=starts)],
        code=code,
        **options,
    )
