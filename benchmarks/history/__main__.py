r"""In which releases of MuJoCo speed changed, and what accounts for it.

    python -m benchmarks.history measure [RELEASE]… [--since VERSION] [--model MODEL]…
    python -m benchmarks.history explain [RELEASE]… [--since VERSION] [--model MODEL]…
    python -m benchmarks.history page
    python -m benchmarks.history append
    python -m benchmarks.history verify

`measure` times steps and operations in releases against one fixed release, two minutes each.
`explain` counts instructions by function, from each release to the next; it needs valgrind, but no
quiet machine. `page` draws docs/history/ and writes docs/history.md from what both stored.
`append` adds new releases to benchmarks/releases.bundle, the git history that asv walks, and
`verify` builds that again and compares every hash; its exit code is 1 if one differs.
"""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import click

from benchmarks.history import bundle, files, known_causes, measurements, page, plots, ratio_section
from benchmarks.history.release_ratios import REFERENCE, RatioRecord
from benchmarks.history.tasks import Selection
from benchmarks.operations import registry
from benchmarks.studies import tally_command
from mjbench.cli.context import measure_and_print
from mjbench.cli.shared import as_one, takes
from mjbench.commands.shared_options import RunFileOptions, results_option
from mjbench.counts.records import ExplainRecord
from mjbench.counts.show import explanations
from mjbench.errors import InputError, MachineError
from mjbench.releases import installs, package_index, release_names
from mjbench.releases.release import OLDEST, version_key
from mjbench.simulation.models import resolve, shipped
from mjbench.status import ExitCode

RESULTS = Path("results/history")
PAGE, PLOTS = files.ROOT / "docs/history.md", files.ROOT / "docs/history"


@click.group(help=__doc__)
def history() -> None:
    """Measure releases, count their instructions, and write the page of both."""


def _releases(names: Sequence[str], since: str | None) -> list[release_names.ReleaseSpec]:
    """Return the releases with these names; without names, those of the history from `since` on."""
    if names and since:
        raise InputError("give RELEASEs or --since, not both")
    if names:
        return installs.parse_available(names)
    versions = [
        release.version
        for release in bundle.read(bundle.default_path())
        if version_key(release.version) >= OLDEST  # the history begins one release earlier, for asv
    ]
    if since is not None and since not in versions:
        raise InputError(
            f"{bundle.default_path()} has no release {since}; it has {len(versions)},"
            f" from {versions[0]} to {versions[-1]}"
        )
    first = versions.index(since) if since else 0
    return [release_names.parse_release(version) for version in versions[first:]]


def _select(
    names: Sequence[str], since: str | None, models: Sequence[str], operations: bool | None
) -> Selection:
    """Return what is measured; `operations` is None for those of a run over all models."""
    has_operations = not models if operations is None else operations
    return Selection(
        release_names.parse_release(REFERENCE),
        _releases(names, since),
        [resolve(name) for name in models or shipped()],
        list(registry().values()) if has_operations else [],
    )


_SELECTION = as_one(
    "selection",
    _select,
    click.argument("names", nargs=-1, metavar="[RELEASE]…"),
    click.option("--since", metavar="VERSION", help="Without a RELEASE: those from VERSION on."),
    click.option("--model", "models", multiple=True, metavar="MODEL", help="May be repeated."),
    click.option(
        "--operations/--no-operations",
        default=None,
        help="Include operations around the step  [default: unless --model is given]",
    ),
)


@dataclass(frozen=True, kw_only=True)
class HistoryOptions(RunFileOptions):
    """Where the run file lies."""

    results: Path = results_option(RESULTS)


@history.command()
@_SELECTION
@takes(HistoryOptions)
def measure(selection: Selection, options: HistoryOptions) -> None:
    """Time steps and operations in RELEASEs against one fixed release."""
    measure_and_print(
        measurements.ratios(selection),
        options,
        summary=lambda run: [ratio_section.section(run.of_type(RatioRecord))],
    ).exit()


@history.command()
@_SELECTION
@takes(HistoryOptions)
def explain(selection: Selection, options: HistoryOptions) -> None:
    """Count instructions by function, from each RELEASE to the next."""
    measure_and_print(
        measurements.changes(selection),
        options,
        each=lambda run: explanations(run.of_type(ExplainRecord)),
    ).exit()


@history.command("page")
def write_page() -> None:
    """Draw the plots and write the page, from the committed run files."""
    measured = files.read(files.run_files(files.ROOT / RESULTS), known_causes.FILE)
    plots.draw(measured, PLOTS)
    lines = page.document(page.sections(measured), PLOTS.name)
    PAGE.write_text("\n".join(lines) + "\n", encoding="utf-8")


_BUNDLE = click.argument(
    "file", metavar="[FILE]", type=click.Path(path_type=Path), default=bundle.default_path
)


@history.command()
@_BUNDLE
def append(file: Path) -> None:
    """Append to the git history the releases on the package index that it lacks."""
    if appended := bundle.update(file, package_index.releases()):
        click.echo(f"appended {', '.join(r.tag for r in appended)} to {file}")
    else:
        click.echo(f"nothing to append: {file} ends with {bundle.read(file)[-1].tag}")


@history.command()
@_BUNDLE
def verify(file: Path) -> None:
    """Build the git history again and compare every hash."""
    indexed, index_problem = None, ""
    try:
        indexed = package_index.releases()
    except MachineError as error:
        index_problem = str(error)
    problems = bundle.verify(file, indexed)
    for problem in problems:
        click.echo(problem)
    if index_problem:
        click.echo(f"Upload times were not checked: {index_problem}", err=True)
    if problems:
        sys.exit(ExitCode.FINDING)
    click.echo(f"{file}: {len(bundle.read(file))} releases, every hash is as expected")


if __name__ == "__main__":
    sys.exit(tally_command.run_measuring("history", history))
