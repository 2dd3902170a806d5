"""`mjbench results`: run files of several machines in one run set, and a site of all results."""

from pathlib import Path

import click

from mjbench.cli.context import RunContext
from mjbench.cli.group import cli, report_line
from mjbench.cli.shared import FILE, JSON
from mjbench.errors import InputError


@cli.group()
def results() -> None:
    """Merge run files into a set, or write a site of all of them.

    `mjbench show` prints and compares runs, and writes reports and formats of other tools.
    """


@results.command(short_help="merge run files into one, a run set")
@click.argument("files", nargs=-1, required=True, metavar="RUN…", type=FILE)
@click.option(
    "-o",
    "--output",
    required=True,
    metavar="SET",
    type=FILE,
    help="Run set to write. If it exists, runs that it lacks are appended.",
)
@JSON
def merge(files: tuple[Path, ...], output: Path, json_file: str | None) -> None:
    """Merge run files of one or several machines into one file, a run set.

    The set has every run once, unchanged. Sets can be merged, too. `show`, `history`
    and mjbench.load read sets like run files. They tell machines apart by the environment
    variable MJBENCH_MACHINE of the command that measured, otherwise by a hash of the host.

    \b
    Example:
      mjbench results merge runs-*/*.jsonl -o all.jsonl
      mjbench show all.jsonl --html
    """
    from mjbench.report.documents import MergeDocument
    from mjbench.report.kinds import RECORD_TYPES
    from mjbench.store import run_set

    if str(output) == "-":
        raise InputError("a run set cannot go to standard output: give -o FILE")
    with RunContext(json_file, [*files, output]) as run:
        merged = run_set.merge(files, output, RECORD_TYPES)
        for path in merged.torn:
            report_line(f"{path}: its end was cut short; the incomplete part is left out")
        document = MergeDocument.of(output, merged)
        run.out.print(f"{output}: {document.summary}", soft_wrap=True)
        run.write(document)


@results.command(short_help="write a static site of results and documents")
@click.option(
    "-o",
    "--output",
    metavar="DIR",
    default="site",
    show_default=True,
    type=FILE,
    help="Folder of the site. A site that is there is replaced; another folder is not.",
)
@click.option(
    "--project",
    metavar="DIR",
    default=".",
    show_default=True,
    type=FILE,
    help="Folder that holds results/runs, results/history, docs, .asv/html and build/lab, or some.",
)
def site(output: Path, project: Path) -> None:
    """Write a static site: the history of releases, reports of all runs, and the documents.

    The first page has the conclusions. Each release and each run file has its own page. If
    `asv publish` wrote pages, or `make lab` its page, they are on the site, too. It needs Sphinx,
    MyST and Furo: the extra `site`.

    \b
    Examples:
      mjbench results site -o build/site
      python -m http.server --directory build/site
    """
    from mjbench.host import files
    from mjbench.pages import site as pages

    pages.check_output(output, project)
    with RunContext() as run, files.temporary_folder() as folder:
        for warning in pages.build(pages.read(project, report_line), folder, output):
            report_line(warning)
        run.out.print(f"Site: {output / 'index.html'}", soft_wrap=True)
