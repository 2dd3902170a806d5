"""`mjbench web`: MuJoCo's WebAssembly builds beside C of the same release."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mjbench.cli.context import OutputOptions, measure_and_print
from mjbench.cli.group import cli
from mjbench.cli.shared import FILE, LIMIT, SIZES, STORING, budget, models_argument, with_options
from mjbench.simulation.models import ModelSource

if TYPE_CHECKING:
    from mjbench.api.session import Observer
    from mjbench.paired.run_sizes import Sizes
    from mjbench.releases.installs import ReleaseSpec
    from mjbench.store.runs import Record
    from mjbench.web.build_run import Engine


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
def web(
    sources: list[ModelSource],
    release: str | None,
    package_folder: Path | None,
    node_command: str,
    budget_s: float,
    sizes: "Sizes",
    time_limit: float,
    output: OutputOptions,
) -> None:
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
    from mjbench.api.session import Item, Measurement, finished, in_turn, input_files
    from mjbench.paired.worker_pool import WorkerPool
    from mjbench.releases import installs
    from mjbench.web import measure as builds
    from mjbench.web.records import WebRecord

    spec = None if release is None else installs.parse_release(release)
    engine = _engine(spec, package_folder, node_command, time_limit)
    spec = spec or installs.parse_release(engine.package.version)
    plan = builds.WebPlan(spec, engine, sizes, budget_s)

    def items(earlier: "Sequence[Record]", observer: "Observer") -> "Iterator[Item]":
        with WorkerPool(time_limit) as pool:

            def measure(source: ModelSource, _: object) -> Item:
                return Item([builds.measure(pool, source, plan)])

            yield from in_turn(sources, measure, earlier, observer)

    arguments = {
        "models": [source.name for source in sources],
        "release": spec.key,
        "node": engine.node.version,
        "sizes": sizes,
        "budget_s": budget_s,
    }
    files = input_files(sources, [], sizes.starts)
    measurement = Measurement("web", arguments, files, items, finished)
    run = measure_and_print(measurement, output)
    records = run.session.run().of_type(WebRecord)
    run.exit(status for record in records for status in record.statuses())


def _engine(
    release: "ReleaseSpec | None", package_folder: Path | None, node_command: str, limit_s: float
) -> "Engine":
    from mjbench.host import machine
    from mjbench.web import node_process, npm_package
    from mjbench.web.build_run import Engine

    package = npm_package.find(None if release is None else release.version, package_folder)
    return Engine(package, node_process.find_node(node_command), limit_s, machine.usable_cores())
