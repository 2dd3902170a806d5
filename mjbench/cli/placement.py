"""The command `mjbench placement`: how far a step's time depends on where the code lies."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mjbench.cli import paired_options
from mjbench.cli.context import RunContext, Storage
from mjbench.cli.group import cli
from mjbench.cli.shared import COUNT, STARTS, STORING, Seconds, start_plan, with_options
from mjbench.status import Status

if TYPE_CHECKING:
    from mjbench.paired.placement_spread import SpreadPlan, SpreadRecord
    from mjbench.paired.targets import Target


@cli.command()
@click.argument("names", nargs=-1, metavar="[MODEL]…")
@click.option(
    "--release",
    "release_name",
    default="installed",
    show_default=True,
    metavar="RELEASE",
    help="A version such as 3.5.0, a wheel, a folder of wheels, or `installed`.",
)
@click.option(
    "--launches",
    type=COUNT,
    default=14,
    show_default=True,
    help="Launches for each of the four placements; an interval needs at least 9.",
)
@click.option(
    "--time-limit",
    type=Seconds(),
    default="180s",
    show_default=True,
    help="Time for each model, once it is loaded; after it, no launch begins.",
)
@with_options(*STARTS, *STORING)
def placement(
    names: tuple[str, ...],
    release_name: str,
    launches: int,
    time_limit: float,
    settle_s: float | None,
    states_file: Path | None,
    actions_file: Path | None,
    results: Path,
    resume: Path | None,
    wait: bool,
    json_file: str | None,
) -> None:
    """How far does the time of a step depend on where MuJoCo's machine code lies in memory?

    Compares a release as shipped with the same release moved by 0, 16, 32 and 48 bytes within a
    cache line. A benchmark of one build cannot tell smaller differences than these from a change of
    the code. Without a MODEL: cartpole and humanoid.

    \b
    Examples:
      mjbench placement robot.xml
      mjbench placement cloth pile --release 3.3.1
    """
    from mjbench.paired import placement_spread
    from mjbench.paired.placement_spread import SpreadPlan
    from mjbench.paired.run_sizes import Sizes
    from mjbench.paired.targets import Target
    from mjbench.releases.installs import parse_release
    from mjbench.report.kinds import PLACEMENT
    from mjbench.simulation import models

    release = parse_release(release_name)
    sources = [models.resolve(name) for name in names or ("cartpole", "humanoid")]
    targets = [Target(release, source) for source in sources]
    starts = start_plan(settle_s, states_file, actions_file)
    plan = SpreadPlan(launches, time_limit, Sizes(starts=starts))
    paired_options.warn_if_unpinned()
    arguments = {**asdict(plan), "targets": [target.row() for target in targets]}
    storage = Storage(results, arguments, resume, placement_spread.finished)
    files = [*paired_options.input_files(targets), *starts.files]
    with RunContext("placement", json_file, files, storage, wait) as run:
        rows = _measure(run, targets, plan)
        if any(row.status == Status.INTERRUPTED for row in rows):
            run.interrupt()
        run.show_results(PLACEMENT)
        run.write_results(PLACEMENT)
    run.exit(row.status for row in rows)


def _measure(
    run: RunContext, targets: Sequence["Target"], plan: "SpreadPlan"
) -> list["SpreadRecord"]:
    """Measure each target that is not yet in the run file, and store it; return all rows."""
    from mjbench.paired import placement_spread
    from mjbench.paired.worker_pool import WorkerPool
    from mjbench.releases.placement import RESIDUES

    earlier = {record.model: record for record in placement_spread.finished(run.resumed_records)}
    rows: list[SpreadRecord] = []
    with run.progress(len(targets)) as advance, WorkerPool() as pool:
        for number, target in enumerate(targets):
            name = target.model.name
            if name in earlier:
                rows.append(earlier[name])
                continue

            def on_launch(count: int, number: int = number, name: str = name) -> None:
                advance(number, name, count / (plan.launches * len(RESIDUES)))

            record = placement_spread.measure(pool, target, plan, on_launch)
            run.record(record)
            rows.append(record)
            if record.status == Status.INTERRUPTED:
                break
    return rows
