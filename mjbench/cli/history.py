"""`mjbench history`: what happened to speed from one release to the next, and why."""

import os
from pathlib import Path

import click

from mjbench.cli import interrupts
from mjbench.cli.group import cli
from mjbench.cli.output_file import OutputFile
from mjbench.cli.shared import PAGE

DEFAULT = click.core.ParameterSource.DEFAULT


@cli.group(invoke_without_command=True)
@click.option(
    "--since",
    metavar="VERSION",
    help="List only changes from VERSION on.",
)
@click.option(
    "--results",
    default="results/history",
    show_default=True,
    metavar="DIR",
    type=click.Path(path_type=Path),
    help="Folder with the run files of `history measure` and `history explain`, or run sets.",
)
@click.option(
    "--causes",
    metavar="FILE",
    type=click.Path(path_type=Path),
    help="Causes that no measurement names  [default: benchmarks/causes.toml of the checkout]",
)
@click.option(
    "--plots",
    metavar="DIR",
    type=click.Path(path_type=Path),
    help="Draw a plot of each model there, as SVG, and show them on the page.",
)
@click.option(
    "--machine",
    metavar="NAME",
    help="Report the history of this machine only. Without it, if the folder has several machines,"
    " the page says on how many of them each change is listed.",
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
        given = [name for name in ctx.params if ctx.get_parameter_source(name) != DEFAULT]
        if given:
            option = given[0].replace("_", "-")
            raise click.UsageError(f"give --{option} after {ctx.invoked_subcommand}")
        return
    from mjbench.pages import markdown
    from mjbench.releases import bundle
    from mjbench.report import history as history_sections
    from mjbench.report import history_across, history_files, history_plots

    committed = bundle.default_path().with_name("causes.toml")
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
    """Return the folder of plots as a page is to link it; empty without any."""
    if plots is None:
        return ""
    base = output.parent if output else Path()
    return Path(os.path.relpath(plots, base)).as_posix()
