"""`mjbench history measure`: the time of a step in releases against one fixed release."""

from collections.abc import Sequence
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
    from mjbench.paired.targets import Target
    from mjbench.releases.step_ratios import StepRatioRecord


@history.command("measure")
@click.argument("names", nargs=-1, metavar="[RELEASE]…")
@with_options(*history_options.SELECTING, HISTORY, RESUME, WAIT, JSON)
def measure(
    names: tuple[str, ...],
    since: str | None,
    models: tuple[str, ...],
    results: Path,
    history: Path | None,
    resume: Path | None,
    wait: bool,
    json_file: str | None,
) -> None:
    """Measure the time of a step in RELEASEs against one fixed release.

    A release is a version (3.5.0), a wheel or a folder of wheels, or `installed`. Each takes two
    to three minutes for the ten shipped models, on two cores. The run file has every launch.

    \b
    Examples:
      mjbench history measure --since 3.17.0
      mjbench history measure dist/mujoco-4.1.0-cp311-….whl --model humanoid
    """
    from mjbench.paired.targets import Target
    from mjbench.releases import step_ratios
    from mjbench.report import step_ratios as report
    from mjbench.report.documents import HistoryDocument

    selection = history_options.select(names, since, models, history)
    pairs = [
        (Target(selection.reference, source), Target(release, source))
        for release in selection.releases
        for source in selection.sources
    ]
    paired_options.warn_if_unpinned()
    storage = Storage(results, selection.arguments(), resume, step_ratios.finished)
    files = paired_options.input_files([target for _, target in pairs])
    with RunContext("history", json_file, files, storage, wait) as run:
        records = _measure(run, pairs)
        if any(record.status == Status.INTERRUPTED for record in records):
            run.interrupt()
        report.print_table(run.out, records)
        run.write(HistoryDocument(machine=run.machine, results=records))
    run.exit(record.status for record in records)


def _measure(
    run: RunContext, pairs: Sequence[tuple["Target", "Target"]]
) -> list["StepRatioRecord"]:
    """Measure what is not yet in the run file, and store it; return all records."""
    from mjbench.paired import step_ratio
    from mjbench.paired.worker_pool import WorkerPool
    from mjbench.releases import step_ratios

    earlier = {(r.build, r.model): r for r in step_ratios.finished(run.resumed_records)}
    records: list[StepRatioRecord] = []
    with run.progress(len(pairs)) as advance, WorkerPool() as pool:
        for number, (reference, target) in enumerate(pairs):
            stored = earlier.get((target.release.key, target.model.name))
            if stored is not None:
                records.append(stored)
                continue
            name = f"{target.model.name} {target.release.version}"

            def on_launch(count: int, number: int = number, name: str = name) -> None:
                advance(number, name, min(1.0, count / step_ratios.MIN_LAUNCHES))

            record = step_ratio.measure(pool, reference, target, on_launch=on_launch)
            run.record(record)
            records.append(record)
            if record.status == Status.INTERRUPTED:
                break
    return records
