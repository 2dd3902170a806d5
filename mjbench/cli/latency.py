"""`mjbench latency`: how long ticks of a controller take, and which are late."""

from mjbench.cli.context import measure_and_print
from mjbench.cli.group import cli
from mjbench.cli.shared import models_argument, takes
from mjbench.commands.latency.options import LatencyOptions
from mjbench.simulation.models import ModelSource


@cli.command()
@models_argument
@takes(LatencyOptions)
def latency(sources: list[ModelSource], options: LatencyOptions) -> None:
    """How long does each tick of a controller take, and which ticks miss their deadline?

    A tick is a step, or --tick steps with the same controls. Ticks are measured free-running, each
    after the other, and paced: due at a fixed rate, as in a controller. You learn what slow ones
    have in common.

    \b
    Examples:
      mjbench latency humanoid
      mjbench latency robot.xml --rate 1000 --deadline 500us
      mjbench latency robot.xml --rate 500 --tick 2   # 500 Hz, with a timestep of 1 ms
      mjbench latency robot.xml --fail-on missed      # for CI
    """
    from mjbench.commands.latency.measure import LatencyRow, measurement

    run = measure_and_print(measurement(sources, options), options)
    run.exit_with(options.exit_code(run.session.run().of_type(LatencyRow)))
