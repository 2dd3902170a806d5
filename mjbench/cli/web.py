"""`mjbench web`: MuJoCo's WebAssembly builds beside C of the same release."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mjbench.cli.context import RunContext, Storage
from mjbench.cli.group import cli
from mjbench.cli.shared import (
    JSON,
    LIMIT,
    RESULTS,
    SIZES,
    WAIT,
    Seconds,
    check_sizes,
    start_plan,
    with_options,
)
from mjbench.status import Status

if TYPE_CHECKING:
    from mjbench.paired.run_sizes import Sizes
    from mjbench.releases.installs import ReleaseSpec
    from mjbench.simulation.models import ModelSource
    from mjbench.web.build_run import Engine
    from mjbench.web.measure import WebPlan
    from mjbench.web.records import WebRecord


@cli.command()
@click.argument("names", nargs=-1, metavar="[MODEL]…")
@click.option(
    "--release",
    metavar="RELEASE",
    help="Release of MuJoCo to measure  [default: the one that mjbench pins]",
)
@click.option(
    "--package",
    "package_folder",
    metavar="DIR",
    type=click.Path(path_type=Path),
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
@click.option(
    "--budget",
    "budget_s",
    type=Seconds(zero=True),
    default="5s",
    show_default=True,
    help="Time to spend on timing each model.",
)
@with_options(*SIZES, LIMIT, RESULTS, WAIT, JSON)
def web(
    names: tuple[str, ...],
    release: str | None,
    package_folder: Path | None,
    node_command: str,
    budget_s: float,
    time_limit: float,
    results: Path,
    wait: bool,
    json_file: str | None,
    **sizes: Any,
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
    from mjbench.releases import installs
    from mjbench.report.kinds import WEB
    from mjbench.simulation import models
    from mjbench.web.measure import WebPlan

    sources = [models.resolve(name) for name in names or models.shipped()]
    spec = None if release is None else installs.parse_release(release)
    engine = _engine(spec, package_folder, node_command, time_limit)
    spec = spec or installs.parse_release(engine.package.version)
    plan = WebPlan(spec, engine, _sizes(**sizes), budget_s)
    arguments = {
        "models": [source.name for source in sources],
        "release": plan.release.key,
        "node": plan.engine.node.version,
        "sizes": plan.sizes,
        "budget_s": budget_s,
    }
    files = [*(source.path for source in sources), *plan.sizes.starts.files]
    with RunContext("web", json_file, files, Storage(results, arguments), wait) as run:
        records = _measure(run, sources, plan)
        run.write_results(WEB)
    run.exit([status for record in records for status in record.statuses()])


def _engine(
    release: "ReleaseSpec | None", package_folder: Path | None, node_command: str, limit_s: float
) -> "Engine":
    """Return the builds of a release, and the Node that runs them."""
    from mjbench.host import machine
    from mjbench.web import node_process, npm_package
    from mjbench.web.build_run import Engine

    package = npm_package.find(None if release is None else release.version, package_folder)
    return Engine(package, node_process.find_node(node_command), limit_s, machine.usable_cores())


def _sizes(
    nbatch: int | None,
    nstep: int | None,
    hold: int,
    seed: int,
    settle_s: float | None,
    states_file: Path | None,
    actions_file: Path | None,
) -> "Sizes":
    """Return what the options SIZES ask for."""
    from mjbench.paired.run_sizes import Sizes

    check_sizes(nstep, hold)
    starts = start_plan(settle_s, states_file, actions_file)
    return Sizes(nbatch, nstep, hold, seed, starts)


def _measure(
    run: RunContext, sources: "Sequence[ModelSource]", plan: "WebPlan"
) -> list["WebRecord"]:
    """Measure models; print and store what was measured of each."""
    from mjbench.paired.worker_pool import WorkerPool
    from mjbench.report.kinds import WEB
    from mjbench.web import measure

    records = []
    with WorkerPool(plan.engine.limit_s) as pool:
        for source in sources:
            records.append(record := measure.measure(pool, source, plan))
            run.record(record)
            run.show_results(WEB, [record])
            if record.status == Status.INTERRUPTED:
                run.interrupt()
                break
    return records
