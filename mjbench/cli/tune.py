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
    no more than rounding does, then those with an error: a distance from the same model at an
    eighth of its timestep. Recommendations are measured again from new starts.

    \b
    Examples:
      mjbench tune humanoid
      mjbench tune robot.xml --only free
      mjbench tune robot.xml --max-error 1% --budget 600s
    """
    from mjbench.commands.tune.driver import measurement

    measure_and_print(measurement(sources, options), options).exit()
