"""`mjbench history`: what happened to speed from one release to the next."""

from pathlib import Path

import click

from mjbench.cli import interrupts
from mjbench.cli.group import cli
from mjbench.cli.output_file import OutputFile
from mjbench.cli.releases import HISTORY
from mjbench.cli.shared import PAGE, Share

DEFAULT = click.core.ParameterSource.DEFAULT
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
@PAGE
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

    `mjbench history measure` measures the time of a step in releases against one fixed release, and
    `mjbench history explain` counts its instructions by function. `mjbench history changes` reports
    what both of them show.
    """
    if ctx.invoked_subcommand is not None:
        given = [name for name in ctx.params if ctx.get_parameter_source(name) != DEFAULT]
        if given:
            option = given[0].replace("_", "-")
            raise click.UsageError(f"give --{option} after {ctx.invoked_subcommand}")
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
