"""`mjbench history`: what happened to speed from one release to the next, and why."""

import contextlib
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mjbench.api import interrupts
from mjbench.cli.context import OutputOptions, measure_and_print
from mjbench.cli.group import cli
from mjbench.cli.output_file import OutputFile
from mjbench.cli.releases import HISTORY
from mjbench.cli.shared import FILE, JSON, PAGE, RESUME, WAIT, as_one, results_option, with_options
from mjbench.simulation.models import resolve, shipped

if TYPE_CHECKING:
    from mjbench.paired.history_tasks import Selection

_RESULTS_FOLDER = Path("results/history")
_DEFAULT = click.core.ParameterSource.DEFAULT


@cli.group(invoke_without_command=True)
@click.option("--since", metavar="VERSION", help="List only changes from VERSION on.")
@results_option(
    _RESULTS_FOLDER,
    "Folder with the run files of `history measure` and `history explain`.",
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
    from mjbench.pages.history import page
    from mjbench.releases import known_causes
    from mjbench.report import history_files

    causes = causes or known_causes.default_path()
    files = history_files.run_files(results)
    inputs = [*files, *([causes] if causes else [])]
    interrupts.enable()
    with contextlib.closing(OutputFile("--output", str(output) if output else "-", inputs)) as file:
        file.open()
        folder = output.parent if output else Path()
        file.write(page(files, causes, since, machine, plots, folder))


def _select(
    names: Sequence[str],
    since: str | None,
    models: Sequence[str],
    history: Path,
    steps: bool,
    operations: bool | None,
) -> "Selection":
    from mjbench.paired.history_tasks import Selection
    from mjbench.paired.operations import registry
    from mjbench.releases import catalogue, release_names, release_ratios

    if not steps and models:
        raise click.UsageError("--model is for steps; leave it out with --no-steps")
    if not steps and operations is False:
        raise click.UsageError("without steps and operations, nothing is left")
    has_operations = not models if operations is None else operations
    return Selection(
        release_names.parse_release(release_ratios.REFERENCE),
        catalogue.named_or_since(names, since, history),
        [resolve(name) for name in models or shipped()] if steps else [],
        list(registry().values()) if has_operations else [],
    )


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
def measure(selection: "Selection", output: OutputOptions) -> None:
    """Time steps and operations in RELEASEs against one fixed release.

    A release is a version (3.5.0), a wheel or a folder of wheels, or `installed`. Each takes two
    minutes. The run file has every launch.

    \b
    Examples:
      mjbench history measure --since 3.17.0
      mjbench history measure dist/mujoco-4.1.0-cp311-….whl --model humanoid
    """
    from mjbench.api.history import ratios

    measure_and_print(ratios(selection), output, at_end=True).exit()


@history.command("explain", short_help="count instructions of each release")
@with_options(_SELECTION, as_one("output", OutputOptions, _RESULTS, RESUME, JSON))
def explain(selection: "Selection", output: OutputOptions) -> None:
    """Count instructions of steps and operations by function, from each RELEASE to the next.

    Needs valgrind, but no quiet machine. A release takes several minutes for the ten shipped
    models, and less than one for the operations. The workload of steps is that of one fixed
    release.

    \b
    Example:
      mjbench history explain --since 3.17.0
    """
    from mjbench.api.history import changes
    from mjbench.counts.records import ExplainRecord
    from mjbench.report.counts import change_sections

    measure_and_print(
        changes(selection), output, summary=lambda run: change_sections(run.of_type(ExplainRecord))
    ).exit()
