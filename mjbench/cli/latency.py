"""`mjbench latency`: how long single steps take, and which are late."""

from mjbench.cli.context import measure_and_print
from mjbench.cli.group import cli
from mjbench.cli.shared import models_argument, takes
from mjbench.commands.latency.options import LatencyOptions
from mjbench.simulation.models import ModelSource


@cli.command()
@models_argument("cartpole")
@takes(LatencyOptions)
def latency(sources: list[ModelSource], options: LatencyOptions) -> None:
    """How long do single steps take, which miss their deadline, and what do slow ones share?

    Steps are measured free-running, each after the other, and paced: due at a fixed rate, as in a
    controller. Without a MODEL: cartpole.

    \b
    Examples:
      mjbench latency humanoid
      mjbench latency robot.xml --rate 1000 --deadline 500us
    """
    from mjbench.commands.latency.measure import measurement

    measure_and_print(measurement(sources, options), options).exit()
