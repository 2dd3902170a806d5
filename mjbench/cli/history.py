"""`mjbench history`: what happened to speed from one release to the next, and why."""

import itertools
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mjbench.api import interrupts
from mjbench.cli.context import OutputOptions, measure_and_print
from mjbench.cli.group import cli
from mjbench.cli.output_file import OutputFile
from mjbench.cli.releases import HISTORY
from mjbench.cli.shared import FILE, JSON, PAGE, RESUME, WAIT, as_one, results_option, with_options
from mjbench.errors import InputError
from mjbench.simulation import models as model_sources
from mjbench.simulation.models import ModelSource

if TYPE_CHECKING:
    from mjbench.api.session import Item, Observer
    from mjbench.counts.counted_program import OperationRequest
    from mjbench.counts.instructions import ModelCount
    from mjbench.counts.records import ExplainRecord
    from mjbench.paired.operations import Operation
    from mjbench.paired.release_tasks import ReleaseTask
    from mjbench.releases.installs import ReleaseSpec
    from mjbench.store.runs import Record

_RESULTS_FOLDER = Path("results/history")
_DEFAULT = click.core.ParameterSource.DEFAULT
# Of each model and pair of releases, as many functions are stored, and those that exchanged cost
# with them.
_TOP = 12


@cli.group(invoke_without_command=True)
@click.option("--since", metavar="VERSION", help="List only changes from VERSION on.")
@results_option(
    _RESULTS_FOLDER,
    "Folder with the run files of `history measure` and `history explain`, or run sets.",
)
@click.option(
    "--causes",
    metavar="FILE",
    type=FILE,
    help="Causes that no measurement names  [default: benchmarks/causes.toml of the checkout]",
)
@click.option(
    "--plots",
    metavar="DIR",
    type=FILE,
    help="Draw a plot of each model there, as SVG, and show them on the page.",
)
@click.option(
    "--machine",
    metavar="NAME",
    help="Report the history of this machine only. Without it, if the folder has several machines,"
    " the page names on how many of them each change is listed.",
)
@PAGE
@click.pass_context
def history(
    ctx: click.Context,
    since: str | None,
    results: Path,
    causes: Path | None,
    plots: Path | None,
    machine: str | None,
    output: Path | None,
) -> None:
    """Report in which releases speed changed, and what accounts for it.

    The report is a page in Markdown, from what `mjbench history measure` and `mjbench history
    explain` stored. docs/history.md is such a page.

    \b
    Example: what did the last release do?
      mjbench history measure 3.16.0 3.17.0 4.0.0
      mjbench history explain 3.17.0 4.0.0
      mjbench history --since 4.0.0
    """
    if ctx.invoked_subcommand is not None:
        given = [name for name in ctx.params if ctx.get_parameter_source(name) != _DEFAULT]
        if given:
            option = given[0].replace("_", "-")
            raise click.UsageError(f"give --{option} after {ctx.invoked_subcommand}")
        return
    from mjbench.pages import markdown
    from mjbench.releases import known_causes
    from mjbench.report import history as history_sections
    from mjbench.report import history_across, history_files, history_plots

    committed = known_causes.default_path()
    causes = causes or (committed if committed.exists() else None)
    files = history_files.run_files(results)
    inputs = [*files, *([causes] if causes else [])]
    page = OutputFile("--output", str(output) if output else "-", inputs)
    interrupts.enable()
    page.open()
    try:
        each = history_files.read_each(files, causes, since)
        if len(each) > 1 and machine is None and plots is None:
            sections = iter([history_across.section(each)])
        else:
            measured = history_files.choose(each, machine)
            if plots is not None:
                history_plots.draw(measured, plots)
            sections = history_sections.sections(measured, has_plots=plots is not None)
        lines = markdown.document(sections, _link(plots, output))
        page.write("\n".join(lines) + "\n")
    finally:
        page.close()


def _link(plots: Path | None, output: Path | None) -> str:
    if plots is None:
        return ""
    base = output.parent if output else Path()
    return Path(os.path.relpath(plots, base)).as_posix()


@dataclass(frozen=True)
class _Selection:
    reference: "ReleaseSpec"
    releases: Sequence["ReleaseSpec"]
    sources: Sequence[ModelSource]
    operations: Sequence["Operation"]

    def arguments(self) -> dict[str, object]:
        return {
            "reference": self.reference.key,
            "releases": [release.key for release in self.releases],
            "models": [source.name for source in self.sources],
            "operations": bool(self.operations),
        }


def _select(
    names: Sequence[str],
    since: str | None,
    models: Sequence[str],
    history: Path,
    steps: bool,
    operations: bool | None,
) -> _Selection:
    """Return what the options and arguments of a subcommand select; see `_releases`."""
    from mjbench.paired.operations import registry
    from mjbench.releases import installs, release_ratios

    if not steps and models:
        raise click.UsageError("--model is for steps; leave it out with --no-steps")
    if not steps and operations is False:
        raise click.UsageError("without steps and operations, nothing is left")
    model_names = (models or model_sources.shipped()) if steps else ()
    has_operations = not models if operations is None else operations
    return _Selection(
        installs.parse_release(release_ratios.REFERENCE),
        _releases(names, since, history),
        [model_sources.resolve(name) for name in model_names],
        list(registry().values()) if has_operations else [],
    )


def _releases(names: Sequence[str], since: str | None, history: Path) -> list["ReleaseSpec"]:
    from mjbench.releases import bundle, installs
    from mjbench.releases.release import OLDEST, version_key

    if names and since:
        raise InputError("give RELEASEs or --since, not both")
    if names:
        return [installs.parse_release(name) for name in names]
    versions = [
        release.version
        for release in bundle.read(history)
        if version_key(release.version) >= OLDEST  # the history begins one release earlier, for asv
    ]
    if since is not None and since not in versions:
        raise InputError(
            f"{history} has no release {since}; it has {len(versions)},"
            f" from {versions[0]} to {versions[-1]}"
        )
    first = versions.index(since) if since else 0
    return [installs.parse_release(version) for version in versions[first:]]


_RESULTS = results_option(_RESULTS_FOLDER, "Folder for the run file.")
_SELECTION = as_one(
    "selection",
    _select,
    click.argument("names", nargs=-1, metavar="[RELEASE]…"),
    click.option(
        "--steps/--no-steps", default=True, show_default=True, help="Include steps of models."
    ),
    click.option(
        "--operations/--no-operations",
        default=None,
        help="Include loading, MjSpec, MjData, resets, rays, rollout and Batch on shipped models"
        "  [default: unless --model is given]",
    ),
    click.option(
        "--since",
        metavar="VERSION",
        help="Without a RELEASE: those of the git history from VERSION on, rather than all.",
    ),
    click.option(
        "--model",
        "models",
        multiple=True,
        metavar="MODEL",
        help="A model; may be given several times  [default: all shipped models]",
    ),
    HISTORY,
)


@history.command("measure", short_help="time releases against one of them")
@with_options(_SELECTION, as_one("output", OutputOptions, _RESULTS, RESUME, WAIT, JSON))
def measure(selection: _Selection, output: OutputOptions) -> None:
    """Time steps and operations in RELEASEs against one fixed release.

    A release is a version (3.5.0), a wheel or a folder of wheels, or `installed`. Each takes two
    minutes. The run file has every launch.

    \b
    Examples:
      mjbench history measure --since 3.17.0
      mjbench history measure dist/mujoco-4.1.0-cp311-….whl --model humanoid
    """
    from mjbench.api.session import Measurement, input_files, pinning_notes
    from mjbench.releases import release_ratios
    from mjbench.simulation.starts import DEFAULT_STARTS

    measurement = Measurement(
        "history",
        selection.arguments(),
        input_files(selection.sources, selection.releases, DEFAULT_STARTS),
        lambda earlier, observer: _measure_releases(selection, earlier, observer),
        release_ratios.finished,
        pinning_notes(),
    )
    measure_and_print(measurement, output, at_end=True).exit()


def _measure_releases(
    selection: _Selection, earlier: "Sequence[Record]", observer: "Observer"
) -> "Iterator[Item]":
    from mjbench.api.session import Item
    from mjbench.paired import release_ratio
    from mjbench.paired.worker_pool import WorkerPool
    from mjbench.releases import release_ratios

    finished = release_ratios.finished(earlier)
    done = {(record.record_type, record.build, record.series) for record in finished}
    by_release = [
        [
            task
            for task in _tasks(selection, release)
            if (task.record_type, release.key, task.series) not in done
        ]
        for release in selection.releases
    ]
    remaining = [tasks for tasks in by_release if tasks]
    shares = [0.0] * len(remaining)

    def on_launch(index: int, share: float) -> None:
        shares[index] = share
        _, release = remaining[index][0].releases
        observer(f"MuJoCo {release.version}", sum(shares) / len(remaining))

    with WorkerPool() as pool:
        for records in release_ratio.measure_each(pool, remaining, on_launch):
            yield Item(records)


def _tasks(selection: _Selection, release: "ReleaseSpec") -> list["ReleaseTask"]:
    from mjbench.paired.release_tasks import OperationTask, StepTask

    releases = selection.reference, release
    return [
        *(StepTask(releases, source) for source in selection.sources),
        *(
            OperationTask(releases, operation, _model_of(operation))
            for operation in selection.operations
        ),
    ]


def _model_of(operation: "Operation") -> ModelSource | None:
    return model_sources.resolve(operation.model) if operation.model else None


@history.command("explain", short_help="count instructions of each release")
@with_options(_SELECTION, as_one("output", OutputOptions, _RESULTS, RESUME, JSON))
def explain(selection: _Selection, output: OutputOptions) -> None:
    """Count instructions of steps and operations by function, from each RELEASE to the next.

    Needs valgrind, but no quiet machine. A release takes several minutes for the ten shipped
    models, and less than one for the operations. The workload of steps is that of one fixed
    release.

    \b
    Example:
      mjbench history explain --since 3.17.0
    """
    from mjbench.api.session import Measurement
    from mjbench.counts import records
    from mjbench.counts.records import ExplainRecord
    from mjbench.report.counts import change_sections

    if len(selection.releases) < 2:
        raise InputError("give two releases or more")
    measurement = Measurement(
        "history-explain",
        selection.arguments(),
        [source.path for source in selection.sources],
        lambda earlier, observer: _explain_releases(selection, earlier, observer),
        records.finished,
    )
    measure_and_print(
        measurement, output, summary=lambda run: change_sections(run.of_type(ExplainRecord))
    ).exit()


def _explain_releases(
    selection: _Selection, earlier: "Sequence[Record]", observer: "Observer"
) -> "Iterator[Item]":
    """Count each release, and yield what changed since the one before."""
    from mjbench.api.session import Item
    from mjbench.counts import records
    from mjbench.counts.instructions import InstructionCounter

    done = {(record.old, record.new, record.series) for record in records.finished(earlier)}
    missing = _releases_to_count(selection, done)
    before: Sequence[ModelCount] = ()
    with InstructionCounter() as counter:
        if missing and selection.sources:
            list(counter.count(selection.reference, selection.sources))  # draws the workloads
        for number, release in enumerate(selection.releases):
            observer(f"MuJoCo {release.version}", number / len(selection.releases))
            if release.version not in missing:
                before = ()
                continue
            counts = [
                *counter.count(release, selection.sources),
                *counter.count(release, _requests(selection)),
            ]
            yield Item(
                [
                    _record(old, new)
                    for old, new in zip(before, counts, strict=bool(before))
                    if (old.release, new.release, new.operation or new.model) not in done
                ]
            )
            before = counts


def _releases_to_count(selection: _Selection, done: set[tuple[str, str, str]]) -> set[str]:
    selected = [source.name for source in selection.sources]
    selected += [operation.name for operation in selection.operations]
    versions = [release.version for release in selection.releases]
    return {
        version
        for old, new in itertools.pairwise(versions)
        for version in (old, new)
        if any((old, new, name) not in done for name in selected)
    }


def _requests(selection: _Selection) -> list["OperationRequest"]:
    from mjbench.counts.counted_program import OperationRequest

    return [
        OperationRequest(operation.name, _model_of(operation)) for operation in selection.operations
    ]


def _record(old: "ModelCount", new: "ModelCount") -> "ExplainRecord":
    """Return what changed in a model: functions that changed most, and whose cost moved there."""
    from mjbench.counts.explain import explain_change

    row = explain_change(old, new, time=None)
    names = {name for f in row.functions[:_TOP] for name in (f.name, *f.moved_with)}
    functions = [function for function in row.functions if function.name in names]
    return replace(row, functions=functions)
