"""`mjbench compare`: ways of stepping, on each model."""

import sys
from pathlib import Path

from mjbench.cli.context import measure_and_print
from mjbench.cli.group import cli
from mjbench.cli.shared import models_argument, takes
from mjbench.commands.compare.options import CompareOptions
from mjbench.simulation.models import ModelSource


@cli.command()
@models_argument
@takes(CompareOptions)
def compare(sources: list[ModelSource], options: CompareOptions) -> None:
    """Compare ways of stepping MODELs (default: all C paths): do they agree, and how fast are they?

    What they return is compared first, bit by bit; a path that disagrees gets no speed. Then they
    race: in one fresh process after the other, all paths are timed in turns, and paths that are
    certainly slower are dropped. MJX and Warp compile first; they are held to tolerances and
    timed alone. Raw samples go to a run file in results/runs; `mjbench show` prints it again.

    Exit code: 1 if a path disagrees with the plain loop.

    \b
    Examples:
      mjbench compare robot.xml
      mjbench compare humanoid --threads 1,2,4 --nbatch 256 --hold 5
      mjbench compare humanoid --scaling
      mjbench compare robot.xml --rl --scaling --nbatch 4096   # RL: an action every 5 steps
      mjbench compare cartpole --paths mjx,warp,rollout --nbatch 16,256,4096
    """
    from mjbench.api.model_sources import each_once
    from mjbench.commands.compare import show
    from mjbench.commands.compare.driver import measurement, plans_of

    if any(":" in name for name in options.paths or ()):
        sys.path.insert(0, str(Path.cwd()))  # where the user's own paths are
    measure_and_print(
        measurement(each_once(sources), plans_of(options), options.budget),
        options,
        each=show.model_sections,
        summary=show.summary,
        code=options.code,
    ).exit()
