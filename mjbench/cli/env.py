"""`mjbench env`: where the time of an environment's step goes."""

import click

from mjbench.cli.context import measure_and_print
from mjbench.cli.group import cli
from mjbench.cli.shared import takes
from mjbench.commands.env.options import EnvironmentOptions


@cli.command()
@click.argument("names", nargs=-1, required=True, metavar="ENVIRONMENT…")
@takes(EnvironmentOptions)
def env(names: tuple[str, ...], options: EnvironmentOptions) -> None:
    """Where does the time of env.step go, and how fast is the same physics without it?

    ENVIRONMENT is a Gymnasium id, dm_control:DOMAIN-TASK, or MODULE:FACTORY: a function of yours,
    imported from the current folder, that returns an environment. --nstep steps with random actions
    are recorded, and then repeated in rounds. You get the shares of physics, observation, reward,
    controller and wrappers. Nothing is compared before a plain loop has repeated the environment's
    physics, to the last bit. SyncVectorEnv and AsyncVectorEnv step --nbatch environments at once.

    \b
    Examples:
      mjbench env Humanoid-v5
      mjbench env dm_control:humanoid-walk --nstep 500
      mjbench env my_env:make --skip vectors
    """
    from mjbench.commands.env.driver import measurement
    from mjbench.commands.env.result import EnvironmentRecord

    run = measure_and_print(measurement(names, options), options)
    records = run.session.run().of_type(EnvironmentRecord)
    run.exit(status for record in records for status in record.statuses())
