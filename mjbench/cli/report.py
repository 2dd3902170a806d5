"""`mjbench report`: run files and run sets as one HTML file, or as Markdown."""

import contextlib
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mjbench.cli.context import RunContext
from mjbench.cli.group import cli, report_line
from mjbench.cli.output_file import OutputFile
from mjbench.cli.shared import RESULTS
from mjbench.errors import InputError, writing

if TYPE_CHECKING:
    from mjbench.store.run_set import RunSet

# Formats of pages, which several runs share, and of other tools.
_PAGES = ("html", "markdown")
_COMMENT = "comment"
FORMATS = (
    *(*_PAGES, _COMMENT, "csv", "parquet", "github-action-benchmark", "bencher", "otava"),
    "junit",
)


@cli.command()
@click.argument("files", nargs=-1, metavar="[RUN]…", type=click.Path(path_type=Path))
@click.option(
    "-o",
    "--output",
    metavar="FILE",
    help="Write to FILE, or - for stdout  [default: report.html for HTML, stdout for others]",
)
@click.option(
    "--format",
    "form",
    type=click.Choice(FORMATS),
    default="html",
    show_default=True,
    help="html: a page to look at; markdown: for a job summary; comment: verdicts of a RUN, for a"
    " pull request; the others: a RUN for other tools.",
)
@click.option("--markdown", is_flag=True, help="The same as --format markdown.")
@RESULTS
def report(
    files: tuple[Path, ...], output: str | None, form: str, markdown: bool, results: Path
) -> None:
    """Write a report of run files and sets: one HTML file to look at, mail or attach to a CI run.

    Of several machines, it begins with what they show side by side. Without a RUN: the newest in
    results/runs. The file needs no network and nothing beside it. Charts need vl-convert-python and
    Jinja2: the extra `report`.

    \b
    Examples:
      mjbench report -o report.html
      mjbench report results/runs/*.jsonl
      mjbench report --markdown >> "$GITHUB_STEP_SUMMARY"
      mjbench report --format comment -o comment.md
      mjbench report --format junit -o junit.xml
    """
    from mjbench.pages import exports
    from mjbench.store import runs

    form = "markdown" if markdown else form
    chosen = list(files) or [runs.latest(results)]
    target = output or ("report.html" if form == "html" else "-")
    if form not in _PAGES and len(chosen) > 1:
        raise InputError(f"--format {form} takes one RUN; `mjbench merge` makes one of several")
    if form == "parquet" and target == "-":
        raise InputError("--format parquet needs a file: give -o FILE")
    file = OutputFile("-o", target, chosen)
    with RunContext(inputs=chosen) as run, contextlib.closing(file):
        if form == "parquet":
            with writing(Path(target)):
                exports.write_parquet(_stored(chosen[0]), Path(target))
        else:
            file.open()
            file.write(_text(form, chosen))
        if target != "-":
            run.out.print(f"Report: {target}", soft_wrap=True)


def _stored(file: Path) -> "RunSet":
    """Return a run file or set for another tool; say what to know before its numbers."""
    from mjbench.pages import exports
    from mjbench.report.kinds import RECORD_TYPES
    from mjbench.store import run_set

    stored = run_set.read(file, RECORD_TYPES)
    for caution in exports.cautions(stored):
        report_line(caution)
    return stored


def _text(form: str, files: Sequence[Path]) -> str:
    """Return run files and sets in a format."""
    from mjbench.pages import comment, exports, html, markdown, reports

    if form == _COMMENT:
        (named,) = reports.read(files)
        return comment.text(named.run)
    if form not in _PAGES:
        return exports.FORMATS[form](_stored(files[0]))
    content = reports.build(reports.read(files))
    return html.render(content) if form == "html" else "\n".join(markdown.render(content)) + "\n"
