"""A report as GitHub's Markdown: for a job's summary, or a comment on a pull request."""

from collections.abc import Iterator, Sequence

from mjbench.pages.content import Conclusion, DataTable, Report, Tone
from mjbench.report import markdown

_MARKS = {Tone.GOOD: "✅ ", Tone.BAD: "❌ ", Tone.UNSURE: "❔ ", Tone.NEUTRAL: ""}
# Characters that mean something in Markdown or HTML.
_SPECIAL = "\\`*_{}[]<>#|~"


def render(report: Report) -> Iterator[str]:
    """Yield the lines of a report: conclusions first, tables folded."""
    yield f"## {_escaped(report.title)}"
    yield ""
    yield from _conclusions(report.conclusions)
    for section in report.sections:
        yield ""
        yield f"<details><summary>{_html(section.heading)}</summary>"
        yield ""
        yield from _conclusions(section.conclusions)
        for table in section.tables or [figure.data for figure in section.figures]:
            yield ""
            yield from _table(table)
        yield ""
        yield from (f"- {_escaped(note)}" for note in section.notes)
        yield ""
        yield f"Measured by {_code(section.command)}"
        yield ""
        yield "</details>"
    if report.machines.rows:
        yield ""
        yield "<details><summary>Machines and versions</summary>"
        yield ""
        yield from _table(report.machines)
        yield ""
        yield "</details>"


def _conclusions(conclusions: Sequence[Conclusion]) -> Iterator[str]:
    for conclusion in conclusions:
        yield f"- {_MARKS[conclusion.tone]}{_escaped(conclusion.text)}"


def _table(table: DataTable) -> Iterator[str]:
    headings = [_escaped(column.title) or " " for column in table.columns]
    right = {_escaped(column.title) for column in table.columns if column.is_number}
    rows = (
        [_escaped(c.shown(cell)) for c, cell in zip(table.columns, row, strict=True)]
        for row in table.rows
    )
    yield from markdown.table(headings, rows, right)


def _escaped(text: str) -> str:
    """Return a text in which nothing is markup."""
    line = " ".join(text.split())
    for character in _SPECIAL:
        line = line.replace(character, f"\\{character}")
    return line


def _html(text: str) -> str:
    return text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")


def _code(text: str) -> str:
    """Return a text as code, whatever backticks it has."""
    fence = "`"
    while fence in text:
        fence += "`"
    return f"{fence} {text} {fence}" if "`" in text else f"`{text}`"
