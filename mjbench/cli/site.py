"""`mjbench results site`: results and documents of a project as a static site."""

import contextlib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mjbench.cli.context import RunContext
from mjbench.cli.group import report_line
from mjbench.cli.results import results
from mjbench.cli.shared import FILE
from mjbench.errors import InputError

if TYPE_CHECKING:
    from mjbench.pages.site import Project


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

    if output.exists() and any(output.iterdir() if output.is_dir() else [output]):
        if not (output / pages.MARKER).is_file():
            raise InputError(f"{output} exists and is no site of mjbench: choose another folder")
        if output.resolve() in (Path.cwd(), project.resolve()):
            raise InputError(f"{output} is the folder of the project: choose another folder")
    with RunContext() as run, scratch.folder() as folder:
        for warning in pages.build(_read(project), folder, output):
            report_line(warning)
        run.out.print(f"Site: {output / 'index.html'}", soft_wrap=True)


def _read(folder: Path) -> "Project":
    from mjbench.pages import reports
    from mjbench.pages import site as pages
    from mjbench.report import history_files

    def own(files: Iterable[Path]) -> list[Path]:
        """Return files of the project; say which others are left out."""
        chosen = []
        for file in files:
            if pages.is_foreign(file, folder):
                report_line(pages.left_out(file, folder))
            elif file.exists():
                chosen.append(file)
        return chosen

    named_runs: list[reports.NamedRun] = []
    for file in own((folder / "results/runs").glob("*.jsonl")):
        with _left_out_if_unreadable():
            named_runs += reports.read([file])
    named_runs.sort(key=lambda named: (named.run.header.began, named.file.name))
    history = None
    causes = next(iter(own([folder / "benchmarks/causes.toml"])), None)
    if files := own(history_files.run_files(folder / "results/history")):
        with _left_out_if_unreadable():
            history, *others = history_files.read_each(files, causes)
            if others:
                names = ", ".join(each.name for each in others)
                report_line(f"the history is that of {history.name}; left out: {names}")
    asv_pages = own([folder / ".asv/html/index.html"])
    if not (named_runs or history or (folder / "docs").is_dir()):
        raise InputError(
            f"{folder} has neither results nor docs: measure something first, or give --project"
        )
    lab = own([folder / "build/lab/mujoco-lab.html"])
    return pages.Project(
        folder,
        named_runs,
        history,
        asv_pages[0].parent if asv_pages else None,
        lab[0] if lab else None,
    )


@contextlib.contextmanager
def _left_out_if_unreadable() -> Iterator[None]:
    """Say why a file is not on the site, where it cannot be read."""
    try:
        yield
    except InputError as error:
        report_line(f"left out: {error}")
