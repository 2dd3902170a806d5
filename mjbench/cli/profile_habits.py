"""`mjbench profile --habits`: what the habits of a Python loop cost."""

from typing import TYPE_CHECKING

import click

from mjbench.cli.context import OutputOptions, measure_and_print
from mjbench.cli.group import cli
from mjbench.cli.shared import LIMIT, LOOP_STARTS, STORING, budget, models_argument, with_options
from mjbench.simulation.models import ModelSource

if TYPE_CHECKING:
    from mjbench.simulation.starts import StartPlan


@cli.command("profile --habits")
@models_argument("cartpole")
@click.option("--code", is_flag=True, help="Print each habit's loop, and its cheaper form.")
@budget(30, "About how long to time the habits of each model.")
@with_options(LOOP_STARTS, LIMIT, STORING)
def profile_habits(
    sources: list[ModelSource],
    code: bool,
    budget_s: float,
    starts: "StartPlan",
    time_limit: float,
    output: OutputOptions,
) -> None:
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
    from mjbench.api.session import of_each_model
    from mjbench.loop import overhead as loop_overhead

    def rows(source: ModelSource) -> list[loop_overhead.OverheadRow]:
        return [loop_overhead.measure(source, time_limit, starts=starts, budget_s=budget_s)]

    measurement = of_each_model(
        "overhead", sources, starts, loop_overhead.OverheadRow, rows, {"budget_s": budget_s}
    )
    measure_and_print(measurement, output, code=code).exit()
