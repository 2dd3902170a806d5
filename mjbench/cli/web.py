"""`mjbench web`: MuJoCo's WebAssembly builds beside C of the same release."""

from typing import Any

import click

from mjbench.cli.context import OutputOptions, measure_and_print
from mjbench.cli.group import cli
from mjbench.cli.shared import FILE, LIMIT, SIZES, STORING, budget, models_argument, with_options


@cli.command()
@models_argument()
@click.option(
    "--release",
    metavar="RELEASE",
    help="Release of MuJoCo to measure  [default: the one that mjbench pins]",
)
@click.option(
    "--package",
    "package_folder",
    metavar="DIR",
    type=FILE,
    help="Folder in which npm installed @mujoco/mujoco  [default: one in the cache folder]",
)
@click.option(
    "--node",
    "node_command",
    default="node",
    show_default=True,
    metavar="COMMAND",
    help="Node.js that runs the builds.",
)
@budget(5, "Time to spend on timing each model.", zero=True)
@with_options(SIZES, LIMIT, STORING)
def web(output: OutputOptions, **options: Any) -> None:
    """How fast is MuJoCo in WebAssembly, and does it compute what the C engine does?

    Steps the builds of the npm package @mujoco/mujoco under Node.js, and the C engine of the same
    release, from the same start states with the same controls. A build whose states differ from
    C's by more than rounding gets no speed. Without a MODEL: all shipped models.

    mjbench does not download the npm package; if it is missing, the message has the command that
    installs it.

    \b
    Examples:
      mjbench web cartpole humanoid
      mjbench web robot.xml --release 3.12.0
      mjbench web --package path/to/your/app --json web.json
    """
    from mjbench.api.web import measurement
    from mjbench.web.records import WebRecord

    run = measure_and_print(measurement(**options), output)
    records = run.session.run().of_type(WebRecord)
    run.exit(status for record in records for status in record.statuses())
