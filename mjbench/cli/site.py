"""`mjbench results site`: results and documents of a project as a static site."""

from pathlib import Path

import click

from mjbench.cli.context import RunContext
from mjbench.cli.group import report_line
from mjbench.cli.results import results
from mjbench.cli.shared import FILE


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
    from mjbench.host import scratch
    from mjbench.pages import site as pages

    pages.check_output(output, project)
    with RunContext() as run, scratch.folder() as folder:
        for warning in pages.build(pages.read(project, report_line), folder, output):
            report_line(warning)
        run.out.print(f"Site: {output / 'index.html'}", soft_wrap=True)
