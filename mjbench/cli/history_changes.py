"""`mjbench history changes`: in which releases the time of a step changed, and why."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mjbench.cli import interrupts
from mjbench.cli.history import history
from mjbench.cli.output_file import OutputFile
from mjbench.cli.releases import HISTORY
from mjbench.cli.shared import PAGE
from mjbench.errors import InputError

if TYPE_CHECKING:
    from mjbench.releases.changelog import Changelog


@history.command("changes")
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
@PAGE
@HISTORY
def changes(since: str | None, results: Path, output: Path | None, history: Path | None) -> None:
    """Report in which releases the time of a step changed, and what accounts for it.

    The report is a page in Markdown, from what `mjbench history measure` and `mjbench history
    explain` stored.

    \b
    Example: what did the last release do?
      mjbench history measure 3.16.0 3.17.0 4.0.0
      mjbench history explain 3.17.0 4.0.0
      mjbench history changes --since 4.0.0
    """
    from mjbench.releases import bundle
    from mjbench.report import speed_history, speed_page

    release_bundle = history or bundle.default_path()
    files = sorted(results.glob("*.jsonl"))
    page = OutputFile("--output", str(output) if output else "-", [release_bundle, *files])
    interrupts.enable()
    page.open()
    try:
        records = [*_records(files)]
        versions = [release.version for release in bundle.read(release_bundle)]
        measured = speed_history.from_records(records, versions, _changelog(), since)
        if not measured.models:
            raise InputError(f"{results} holds no ratios; `mjbench history measure` measures some")
        if since is not None and since not in versions:
            raise InputError(f"{release_bundle} has no release {since}")
        page.write("\n".join(speed_page.lines(measured)) + "\n")
    finally:
        page.close()


def _records(files: list[Path]) -> Iterator[Any]:
    """Yield the records of run files, which must be of one machine.

    Raises:
      InputError: a file cannot be read, or is of another machine.
    """
    from mjbench.instrument import runs
    from mjbench.releases.release_ratios import StepRatioRecord
    from mjbench.report.documents import RECORD_TYPES

    machines: dict[tuple[str, int | None], Path] = {}
    for file in files:
        run = runs.load(file, RECORD_TYPES)
        machine = run.header.machine
        if not run.of_type(StepRatioRecord):  # counts hold for any machine
            yield from run.records
            continue
        machines.setdefault((machine.cpu, machine.cores), file)
        if len(machines) > 1:
            first, other = machines.values()
            raise InputError(f"{first} and {other} are of different machines: name one folder each")
        yield from run.records


def _changelog() -> "Changelog | None":
    """Return MuJoCo's changelog, if the installed package carries it."""
    import importlib.util

    from mjbench.releases import changelog

    spec = importlib.util.find_spec("mujoco")
    folders = spec.submodule_search_locations if spec else None
    file = Path(next(iter(folders))).parent / changelog.FILE if folders else None
    return changelog.read(file) if file and file.exists() else None
