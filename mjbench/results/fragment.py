"""A report as a fragment of HTML, for a notebook: conclusions first, then tables; no charts.

It takes the colours of the page around it, so that it can be read on light and on dark ones; what
has a colour of its own has a contrast of at least 3 on both.
"""

import html
import itertools
from collections.abc import Iterator, Sequence

from mjbench.errors import printable
from mjbench.results.content import Column, Conclusion, DataTable, Report, Tone
from mjbench.results.html import MARKS

# Of the marks before conclusions, which are bold; the texts have the colour of the page.
COLOURS = {
    Tone.CAUTION: "#a87900",
    Tone.GOOD: "#0a8a63",
    Tone.BAD: "#d1492e",
    Tone.UNSURE: "#a87900",
    Tone.NEUTRAL: "inherit",
}
_LINE = "border-bottom:1px solid rgba(128,128,128,.35)"


def render(report: Report, notes: Sequence[str] = ()) -> str:
    """Return a report as a fragment of HTML; all texts are escaped."""
    return "".join(_parts(report, notes))


def _parts(report: Report, notes: Sequence[str]) -> Iterator[str]:
    yield '<div class="mjbench">'
    yield from _conclusions([*report.conclusions, *report.further])
    for note in notes:
        yield f"<p><strong>{_text(note)}</strong></p>"
    for section in (*report.summaries, *report.sections):
        yield from (f"<div>{_text(fact)}</div>" for fact in section.facts)
        for table in section.shown_tables:
            has_several = len(section.shown_tables) > 1
            caption = f"{section.heading}: {table.title}" if has_several else section.heading
            yield from _table(caption, table.filled_columns(with_bars=False))
        if section.notes:
            yield "<details><summary>Notes</summary>"
            yield from (f"<div>{_text(note)}</div>" for note in section.notes)
            yield "</details>"
        for snippet in section.snippets:
            yield f"<details><summary>{_text(snippet.title)}</summary>"
            yield f"<pre>{html.escape(_lines(snippet.code))}</pre></details>"
    yield "</div>"


def _conclusions(conclusions: Sequence[Conclusion]) -> Iterator[str]:
    yield '<ul style="list-style:none;padding:0;margin:.3em 0">'
    for conclusion in conclusions:
        mark = f'<b style="color:{COLOURS[conclusion.tone]}">{MARKS[conclusion.tone]}</b>'
        yield f"<li>{mark} {_text(conclusion.text)}</li>"
    yield "</ul>"


def _table(heading: str, table: DataTable) -> Iterator[str]:
    yield '<table style="border-collapse:collapse;margin:.5em 0">'
    yield f'<caption style="text-align:left">{_text(heading)}</caption>'
    yield "<thead><tr>"
    yield from (_cell("th", column, column.title) for column in table.columns)
    yield "</tr></thead><tbody>"
    for row in table.texts:
        yield "<tr>"
        yield from map(_cell, itertools.repeat("td"), table.columns, row)
        yield "</tr>"
    yield "</tbody></table>"


def _cell(tag: str, column: Column, text: str) -> str:
    align = "right" if column.is_right_aligned else "left"
    scope = ' scope="col"' if tag == "th" else ""
    style = f"text-align:{align};padding:.15em .6em;{_LINE}"
    return f'<{tag}{scope} style="{style}">{_text(text)}</{tag}>'


def _lines(text: str) -> str:
    return "\n".join(map(printable, text.split("\n")))


def _text(text: str) -> str:
    """Return a text in which nothing is markup, or a control character."""
    return html.escape(printable(text))
