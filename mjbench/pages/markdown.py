"""A report as GitHub's Markdown: for a job's summary, or a comment on a pull request."""

import html
from collections.abc import Iterable, Iterator

from mjbench.report import markdown
from mjbench.report.content import DataTable, Report, Tone
from mjbench.report.markdown import code, escaped

_MARKS = {
    Tone.CAUTION: "⚠️ ",
    Tone.GOOD: "✅ ",
    Tone.BAD: "❌ ",
    Tone.UNSURE: "❔ ",
    Tone.NEUTRAL: "",
}


def render(report: Report) -> Iterator[str]:
    """Yield the lines of a report: conclusions first, tables folded."""
    yield f"## {escaped(report.title)}"
    yield ""
    yield from _conclusions((each.text, each.tone) for each in report.conclusions)
    for section in report.sections:
        yield ""
        yield f"<details><summary>{html.escape(section.heading, quote=False)}</summary>"
        yield ""
        yield from _conclusions((each.below_heading, each.tone) for each in section.conclusions)
        yield from (f"- {escaped(fact)}" for fact in section.facts)
        for table in section.shown_tables:
            yield ""
            yield from _table(table)
        yield ""
        yield from (f"- {escaped(note)}" for note in section.notes)
        yield ""
        yield f"Measured by {code(section.command)}"
        yield ""
        yield "</details>"
    if report.machines.rows:
        yield ""
        yield "<details><summary>Machines and versions</summary>"
        yield ""
        yield from _table(report.machines)
        yield ""
        yield "</details>"


def _conclusions(conclusions: Iterable[tuple[str, Tone]]) -> Iterator[str]:
    for text, tone in conclusions:
        yield f"- {_MARKS[tone]}{escaped(text)}"


def _table(table: DataTable) -> Iterator[str]:
    table = table.without_empty_columns()
    headings = [escaped(column.title) or " " for column in table.columns]
    right = {escaped(column.title) for column in table.columns if column.is_number}
    rows = (
        [escaped(c.shown(cell)) for c, cell in zip(table.columns, row, strict=True)]
        for row in table.rows
    )
    yield from markdown.table(headings, rows, right)
