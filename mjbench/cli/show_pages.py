"""`mjbench show --html`, `--markdown` and `--format`: runs as a page, or for other tools."""

import contextlib
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from mjbench.cli.context import RunContext
from mjbench.cli.group import report_line
from mjbench.cli.output_file import OutputFile
from mjbench.errors import InputError

if TYPE_CHECKING:
    from mjbench.commands.show.reports import NamedRun
    from mjbench.results.runs import Run

# Formats of pages, which several runs share, and of other tools.
_PAGES = ("html", "markdown")
_COMMENT = "comment"
FORMATS = (*_PAGES, _COMMENT, "csv", "github-action-benchmark", "junit")


def write(files: Sequence[Path], form: str, output: str | None) -> None:
    """Write run files in a format.

    Args:
      output: a file, or `-` for standard output; None for the default of the format.
    """
    target = output or ("report.html" if form == "html" else "-")
    if form not in _PAGES and len(files) > 1:
        raise InputError(f"--format {form} takes one RUN")
    file = OutputFile("-o", target, files)
    with RunContext(inputs=files) as run, contextlib.closing(file):
        file.open()
        file.write(_content(form, files))
        if target != "-":
            run.out.print(f"Report: {target}", soft_wrap=True)


def _stored(file: Path) -> "Run":
    """Return a run for another tool; say what to know before its numbers."""
    from mjbench.commands.show import exports
    from mjbench.commands.show.kinds import RECORD_TYPES
    from mjbench.results import runs

    stored = runs.load(file, RECORD_TYPES)
    for caution in exports.cautions(stored):
        report_line(caution)
    return stored


def _content(form: str, files: Sequence[Path]) -> str:
    from mjbench.commands.show import comment, exports, reports

    if form == _COMMENT:
        (named,) = reports.read(files)
        return comment.text(named.run)
    if form not in _PAGES:
        return exports.FORMATS[form](_stored(files[0]))
    return page(form, reports.read(files))


def page(form: str, named_runs: "Sequence[NamedRun]") -> str:
    from mjbench.commands.show import reports
    from mjbench.results import html, markdown

    content = reports.build(named_runs)
    return html.render(content) if form == "html" else "\n".join(markdown.render(content)) + "\n"
