"""`mjbench profile --habits`: what the habits of a Python loop cost."""

from typing import Any

import click

from mjbench.cli.context import OutputOptions, measure_and_print
from mjbench.cli.group import cli
from mjbench.cli.shared import LIMIT, LOOP_STARTS, STORING, budget, models_argument, with_options


@cli.command("profile --habits")
@models_argument("cartpole")
@click.option("--code", is_flag=True, help="Print each habit's loop, and its cheaper form.")
@budget(30, "About how long to time the habits of each model.")
@with_options(LOOP_STARTS, LIMIT, STORING)
def profile_habits(code: bool, time_limit: float, output: OutputOptions, **options: Any) -> None:
    """What does each habit of a Python loop cost beside mj_step, and what is cheaper?

    Every habit is timed inside a stepping loop, in turns with the bare loop, in several processes.
    Loops start from states along the model's own run, or from those of --states, and hold their
    controls.
    Without a MODEL: cartpole.

    \b
    Examples:
      mjbench profile --habits cartpole
      mjbench profile --habits robot.mjb --states states.npz
    """
    from mjbench.api.profile import of_habits

    measure_and_print(of_habits(**options, limit_s=time_limit), output, code=code).exit()
