"""`mjbench tune`: which settings make a model faster, and what they cost in accuracy."""

from mjbench.cli.context import measure_and_print
from mjbench.cli.group import cli
from mjbench.cli.shared import models_argument, takes
from mjbench.commands.tune.options import TuneOptions
from mjbench.simulation.models import ModelSource


@cli.command()
@models_argument
@takes(TuneOptions)
def tune(sources: list[ModelSource], options: TuneOptions) -> None:
    """Which settings make a model faster, and what do they cost in accuracy?

    Tries settings alone and together. Those that change no state come first, then those that change
    no more than rounding does, then others, with their error and their change of the motion.
    Recommendations are measured again from new starts. Timesteps must divide the time of --hold
    steps.

    \b
    Examples:
      mjbench tune humanoid
      mjbench tune robot.xml --allow free
      mjbench tune robot.xml --only solver --max-change 1%
      mjbench tune robot.xml --skip timestep --max-error 1% --budget 600s
    """
    from mjbench.commands.tune.driver import measurement

    measure_and_print(measurement(sources, options), options).exit()
