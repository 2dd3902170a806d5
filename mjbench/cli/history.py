"""`mjbench history`: what happened to speed from one release to the next."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mjbench.cli import interrupts, paired_options
from mjbench.cli.context import RunContext, Storage
from mjbench.cli.group import cli
from mjbench.cli.output_file import OutputFile
from mjbench.cli.releases import HISTORY
from mjbench.cli.shared import JSON, RESUME, WAIT, Share, with_options
from mjbench.errors import InputError
from mjbench.status import Status

if TYPE_CHECKING:
    from mjbench.paired.targets import Target
    from mjbench.releases.installs import ReleaseSpec
    from mjbench.releases.step_ratios import StepRatioRecord

# The largest change that can be left out of the page: a time 100 times as long.
MAX_THRESHOLD = 100.0


@cli.group(invoke_without_command=True)
@click.option(
    "--results",
    default="results/asv",
    show_default=True,
    metavar="DIR",
    type=click.Path(path_type=Path),
    help="Folder of asv's results.",
)
@click.option(
    "--machine",
    metavar="NAME",
    help="Machine whose results to read; needed if asv has results of several.",
)
@click.option(
    "--threshold",
    default="5%",
    show_default=True,
    type=Share(below=MAX_THRESHOLD),
    help="List changes above this.",
)
@click.option(
    "--causes",
    metavar="FILE",
    type=click.Path(path_type=Path),
    help="Causes of change points  [default: benchmarks/causes.toml of the checkout]",
)
@click.option(
    "-o",
    "--output",
    metavar="FILE",
    type=click.Path(path_type=Path),
    help="Write the page to FILE  [default: stdout]",
)
@HISTORY
@click.pass_context
def history(
    ctx: click.Context,
    results: Path,
    machine: str | None,
    threshold: float,
    causes: Path | None,
    output: Path | None,
    history: Path | None,
) -> None:
    """Report what changed between releases, from the results of `asv run`.

    The report is a page in Markdown: times by release, change points and their causes, changed
    work, missing values. docs/history.md is written by this command.

    `mjbench history measure` measures the time of a step in releases against one fixed release.
    """
    if ctx.invoked_subcommand is not None:
        return
    from mjbench.releases import asv_results, bundle
    from mjbench.releases.causes import load as load_causes
    from mjbench.report.history import page

    release_bundle = history or bundle.default_path()
    causes = causes or release_bundle.with_name("causes.toml")
    inputs = [release_bundle, causes, *results.rglob("*.json")]
    file = OutputFile("--output", str(output) if output else "-", inputs)
    interrupts.enable()
    file.open()
    try:
        measured = asv_results.load(results, release_bundle, machine)
        file.write(page(measured, load_causes(causes), threshold))
    finally:
        file.close()


@history.command("measure")
@click.argument("names", nargs=-1, metavar="[RELEASE]…")
@click.option(
    "--since",
    metavar="VERSION",
    help="Without a RELEASE: those of the git history from VERSION on, rather than all.",
)
@click.option(
    "--model",
    "models",
    multiple=True,
    metavar="MODEL",
    help="A model; may be given several times  [default: all shipped models]",
)
@click.option(
    "--results",
    default="results/history",
    show_default=True,
    metavar="DIR",
    type=click.Path(path_type=Path),
    help="Folder for the run file.",
)
@HISTORY
@with_options(RESUME, WAIT, JSON)
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

    A release is a version (3.5.0), a wheel or a folder of wheels, or `installed`. Each takes about
    two minutes on two cores. The run file has every launch.

    \b
    Examples:
      mjbench history measure --since 3.17.0
      mjbench history measure dist/mujoco-4.1.0-cp311-….whl --model humanoid
    """
    from mjbench.paired.targets import Target
    from mjbench.releases import installs, step_ratios
    from mjbench.report import step_ratios as report
    from mjbench.report.documents import HistoryDocument
    from mjbench.simulation import models as model_sources

    releases = _releases(names, since, history)
    sources = [model_sources.resolve(name) for name in models or model_sources.shipped()]
    reference = installs.parse_release(step_ratios.REFERENCE)
    pairs = [
        (Target(reference, source), Target(release, source))
        for release in releases
        for source in sources
    ]
    paired_options.warn_if_unpinned()
    arguments = {
        "reference": reference.key,
        "releases": [release.key for release in releases],
        "models": [source.name for source in sources],
    }
    storage = Storage(results, arguments, resume, step_ratios.finished)
    files = paired_options.input_files([target for _, target in pairs])
    files = list(dict.fromkeys(files))
    with RunContext("history", json_file, files, storage, wait) as run:
        records = _measure(run, pairs)
        if any(record.status == Status.INTERRUPTED for record in records):
            run.interrupt()
        report.print_table(run.out, records)
        run.write(HistoryDocument(machine=run.machine, results=records))
    run.exit(record.status for record in records)


def _releases(names: Sequence[str], since: str | None, history: Path | None) -> list["ReleaseSpec"]:
    """Return the releases that arguments name, or those of the git history.

    Raises:
      InputError: there is none, or `since` is not in the history.
    """
    from mjbench.releases import bundle, installs

    if names and since:
        raise InputError("give RELEASEs or --since, not both")
    if names:
        return [installs.parse_release(name) for name in names]
    path = history or bundle.default_path()
    versions = [release.version for release in bundle.read(path)]
    if since is not None and since not in versions:
        raise InputError(f"{path} has no release {since}; it has {', '.join(versions)}")
    first = versions.index(since) if since else 0
    return [installs.parse_release(version) for version in versions[first:]]


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
