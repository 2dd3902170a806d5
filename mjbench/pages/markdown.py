"""A report as GitHub's Markdown: for a job's summary, or a comment on a pull request."""

import html
from collections.abc import Iterable, Iterator

from mjbench.report import markdown
from mjbench.report.content import DataTable, Report, Tone
from mjbench.report.markdown import code, code_block, escaped

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
        yield from _conclusions((each.sentence, each.tone) for each in section.conclusions)
        yield from (f"- {escaped(fact)}" for fact in section.facts)
        for table in section.shown_tables:
            yield ""
            if len(section.shown_tables) > 1:
                yield f"{escaped(table.title)}:"
                yield ""
            yield from _table(table)
        for snippet in section.snippets if section.shows_code else ():
            yield ""
            yield f"{escaped(snippet.title)}:"
            yield ""
            yield from code_block(snippet.code)
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
    table = table.filled_columns(with_bars=False)
    headings = [escaped(column.title) or " " for column in table.columns]
    right = {escaped(column.title) for column in table.columns if column.is_number}
    rows = (
        [escaped(c.shown(cell)) for c, cell in zip(table.columns, row, strict=True)]
        for row in table.rows
    )
    yield from markdown.table(headings, rows, right)
