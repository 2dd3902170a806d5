"""`mjbench history`: what happened to speed from one release to the next, and why."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mjbench.cli import interrupts
from mjbench.cli.group import cli
from mjbench.cli.output_file import OutputFile
from mjbench.cli.releases import HISTORY
from mjbench.cli.shared import PAGE
from mjbench.errors import InputError

if TYPE_CHECKING:
    from mjbench.instrument.machine import Machine
    from mjbench.releases.changelog import Changelog

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
    help="Folder of the run files of `history measure` and `history explain`.",
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
@PAGE
@HISTORY
@click.pass_context
def history(
    ctx: click.Context,
    since: str | None,
    results: Path,
    causes: Path | None,
    plots: Path | None,
    output: Path | None,
    history: Path | None,
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
    from mjbench.releases import bundle, known_causes
    from mjbench.report import history_plots, speed_history, speed_page

    release_bundle = history or bundle.default_path()
    beside_bundle = release_bundle.with_name("causes.toml")
    if causes is None and beside_bundle.exists():
        causes = beside_bundle
    files = sorted(results.glob("*.jsonl"), key=_age)
    inputs = [release_bundle, *files, *([causes] if causes else [])]
    page = OutputFile("--output", str(output) if output else "-", inputs)
    interrupts.enable()
    page.open()
    try:
        known = known_causes.load(causes) if causes else []
        machine, records = read_records(files)
        measured = speed_history.from_records(records, installed_changelog(), known, machine, since)
        if not measured.models:
            raise InputError(
                f"{results} holds no times of steps; `mjbench history measure` measures some"
            )
        if since is not None and since not in measured.releases():
            raise InputError(
                f"{results} has no release {since}; it has {', '.join(measured.releases())}"
            )
        if plots is not None:
            history_plots.draw(measured, plots)
        text = "\n".join(speed_page.lines(measured, _link(plots, output)))
        page.write(f"{speed_page.TITLE}\n\n{text}\n")
    finally:
        page.close()


def _age(file: Path) -> tuple[bool, str]:
    """Return a key that sorts committed run files first, and others by when they began."""
    return not file.name.startswith("reference-"), file.name


def _link(plots: Path | None, output: Path | None) -> str:
    """Return the folder of plots as a page is to link it; empty without any."""
    if plots is None:
        return ""
    base = output.parent if output else Path()
    return Path(os.path.relpath(plots, base)).as_posix()


def read_records(files: Sequence[Path]) -> "tuple[Machine | None, list[Any]]":
    """Return the machine and the records of run files, whose times must be of one machine.

    Raises:
      InputError: a file cannot be read, or is of another machine.
    """
    from mjbench.instrument import runs
    from mjbench.releases.release_ratios import RatioRecord
    from mjbench.report.documents import RECORD_TYPES

    records: list[Any] = []
    timed: dict[Path, Machine] = {}
    for file in files:
        run = runs.load(file, RECORD_TYPES)
        records += run.records
        if run.of_type(RatioRecord):  # counts hold for any machine
            timed[file] = run.header.machine
    for file, machine in timed.items():
        first, of_first = next(iter(timed.items()))
        if (machine.cpu, machine.cores) != (of_first.cpu, of_first.cores):
            raise InputError(
                f"{first} and {file} are of different machines: measure with --results and a folder"
                " of your own, and give that folder here"
            )
    return next(iter(timed.values()), None), records


def installed_changelog() -> "Changelog | None":
    """Return MuJoCo's changelog, if the installed package carries it."""
    import importlib.util

    from mjbench.releases import changelog

    spec = importlib.util.find_spec("mujoco")
    folders = spec.submodule_search_locations if spec else None
    file = Path(next(iter(folders))).parent / changelog.FILE if folders else None
    return changelog.read(file) if file and file.exists() else None
