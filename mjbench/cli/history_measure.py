"""`mjbench history measure`: steps and operations in releases against one fixed release."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from mjbench.cli import history_options, paired_options
from mjbench.cli.context import RunContext, Storage
from mjbench.cli.history import history
from mjbench.cli.releases import HISTORY
from mjbench.cli.shared import JSON, RESUME, WAIT, with_options
from mjbench.status import Status

if TYPE_CHECKING:
    from mjbench.paired.release_tasks import ReleaseTask
    from mjbench.releases.installs import ReleaseSpec
    from mjbench.releases.release_ratios import RatioRecord


@history.command("measure")
@click.argument("names", nargs=-1, metavar="[RELEASE]…")
@with_options(
    history_options.STEPS,
    history_options.OPERATIONS,
    *history_options.SELECTING,
    HISTORY,
    RESUME,
    WAIT,
    JSON,
)
def measure(
    names: tuple[str, ...],
    steps: bool,
    operations: bool | None,
    since: str | None,
    models: tuple[str, ...],
    results: Path,
    history: Path | None,
    resume: Path | None,
    wait: bool,
    json_file: str | None,
) -> None:
    """Time steps and operations in RELEASEs against one fixed release.

    A release is a version (3.5.0), a wheel or a folder of wheels, or `installed`. Each takes two
    minutes. The run file has every launch.

    \b
    Examples:
      mjbench history measure --since 3.17.0
      mjbench history measure dist/mujoco-4.1.0-cp311-….whl --model humanoid
    """
    from mjbench.releases import release_ratios
    from mjbench.report.kinds import HISTORY

    selection = history_options.select(names, since, models, history, steps, operations)
    paired_options.warn_if_unpinned()
    storage = Storage(results, selection.arguments(), resume, release_ratios.finished)
    wheels = [wheel for release in selection.releases for wheel in release.wheels]
    files = [*(source.path for source in selection.sources), *wheels]
    with RunContext("history", json_file, files, storage, wait) as run:
        records = _measure(run, selection)
        if any(record.status == Status.INTERRUPTED for record in records):
            run.interrupt()
        run.show_results(HISTORY)
        run.write_results(HISTORY)
    run.exit(record.status for record in records)


def _measure(run: RunContext, selection: history_options.Selection) -> list["RatioRecord"]:
    """Measure what is not yet in the run file, and store it; return all records."""
    from mjbench.paired import release_ratio
    from mjbench.paired.worker_pool import WorkerPool
    from mjbench.releases import release_ratios

    earlier = release_ratios.finished(run.resumed_records)
    done = {(record.record_type, record.build, record.series) for record in earlier}
    by_release = [
        [
            t
            for t in _tasks(selection, release)
            if (t.record_type, release.key, t.series) not in done
        ]
        for release in selection.releases
    ]
    remaining = [tasks for tasks in by_release if tasks]
    records = [*earlier]
    shares = [0.0] * len(remaining)
    with run.progress(len(remaining)) as advance, WorkerPool() as pool:

        def on_launch(index: int, share: float) -> None:
            shares[index] = share
            _, release = remaining[index][0].releases
            advance(0, f"MuJoCo {release.version}", sum(shares))

        for of_release in release_ratio.measure_each(pool, remaining, on_launch):
            for record in of_release:
                run.record(record)
            records += of_release
    return records


def _tasks(selection: history_options.Selection, release: "ReleaseSpec") -> list["ReleaseTask"]:
    """Return what is timed in a release: the steps of models, and operations."""
    from mjbench.paired.release_tasks import OperationTask, StepTask
    from mjbench.simulation import models

    releases = selection.reference, release
    tasks: list[ReleaseTask] = [StepTask(releases, source) for source in selection.sources]
    for operation in selection.operations:
        model = models.resolve(operation.model) if operation.model else None
        tasks.append(OperationTask(releases, operation, model))
    return tasks
